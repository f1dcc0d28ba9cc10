// What has to be the same for all ranks before they work together.
#pragma once

#include <isonest/preprocess.h>
#include <isonest/volume_source.h>

#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Refuses on rank 0 if ranks see different inputs, or were given different options; the error says
/// which ranks. Collective. Throws Error{invalid_argument}.
void require_same_work(Communicator& ranks, const VolumeSource& source,
                       const PreprocessOptions& options);

}  // namespace isonest::detail
