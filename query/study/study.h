// The comparison of indicators: see <isonest/study.h>.
#pragma once

#include <isonest/progress.h>
#include <isonest/study.h>

#include "store/container/reader.h"

namespace isonest::detail {

Study study(const StoreReader& store, StudyOptions options, Progress& progress);

}  // namespace isonest::detail
