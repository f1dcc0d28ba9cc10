// JSON files of strangers.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

namespace isonest::detail {

/// None if there is no such file. Files of more than 16 MiB and what nests deeper than 64 levels
/// are refused. Numbers that JSON does not know (NaN, Infinity, -Infinity, which Python writes)
/// become strings of that name. Throws Error{corrupt, unsupported, io}.
std::optional<nlohmann::json> read_json(const std::filesystem::path& path);

}  // namespace isonest::detail
