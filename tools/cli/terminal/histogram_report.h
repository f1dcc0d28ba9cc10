// Histograms as JSON and as text.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "query/statistics/histogram.h"

namespace isonest::detail::cli {

// The JSON type of all reports.

using Json = nlohmann::ordered_json;  // keeps the order of insertion

/// The histogram with all bins.
Json histogram_json(const Histogram& h);

/// The value with as many digits as are needed to tell the bins apart (for integers, halves).
std::string value_text(const Histogram& h, double value);
/// At most 32 rows, the suggested isovalues, and an explanation of the numbers.
std::string histogram_text(const Histogram& h);

}  // namespace isonest::detail::cli
