// A histogram for people.
#pragma once

#include <string>

#include "query/statistics/histogram.h"

namespace isonest::detail::cli {

/// The value, as exactly as it takes to tell bins apart (of integers, halves).
std::string value_text(const Histogram& h, double value);
/// At most 32 rows, the suggestions, and what the numbers are of.
std::string histogram_text(const Histogram& h);

}  // namespace isonest::detail::cli
