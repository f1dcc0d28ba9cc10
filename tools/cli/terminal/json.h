// The JSON of all reports.
#pragma once

#include <nlohmann/json.hpp>

namespace isonest::detail::cli {

using Json = nlohmann::ordered_json;  // keeps the order in which it was filled

}  // namespace isonest::detail::cli
