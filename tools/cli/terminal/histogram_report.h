// A histogram for programs and for people, and the JSON of all reports.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "query/statistics/histogram.h"

namespace isonest::detail::cli {

// The JSON of all reports.

using Json = nlohmann::ordered_json;  // keeps the order in which it was filled

/// All bins.
Json histogram_json(const Histogram& h);

// A histogram for people.

/// The value, as exactly as it takes to tell bins apart (of integers, halves).
std::string value_text(const Histogram& h, double value);
/// At most 32 rows, the suggestions, and what the numbers are of.
std::string histogram_text(const Histogram& h);

}  // namespace isonest::detail::cli
