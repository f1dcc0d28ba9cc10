// A histogram for people and for programs.
#pragma once

#include <string>

#include "query/statistics/histogram.h"
#include "tools/cli/command.h"

namespace isonest::detail::cli {

/// The value, as exactly as it takes to tell bins apart (of integers, halves).
std::string value_text(const Histogram& h, double value);
/// At most 32 rows, the suggestions, and what the numbers are of.
std::string histogram_text(const Histogram& h);
/// All bins.
Json histogram_json(const Histogram& h);

}  // namespace isonest::detail::cli
