// A histogram for programs.
#pragma once

#include "query/statistics/histogram.h"
#include "tools/cli/terminal/json.h"

namespace isonest::detail::cli {

/// All bins.
Json histogram_json(const Histogram& h);

}  // namespace isonest::detail::cli
