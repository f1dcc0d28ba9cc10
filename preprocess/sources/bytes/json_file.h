// JSON files of strangers.
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace isonest::detail {

constexpr std::uint64_t kMostJsonBytes = std::uint64_t{1} << 24U;

/// None if there is no such file. Files of more than kMostJsonBytes and what nests deeper than 64
/// levels are refused. Numbers that JSON does not know (NaN, Infinity, -Infinity, which Python
/// writes) become strings of that name. Throws Error{corrupt, unsupported, io}.
std::optional<nlohmann::json> read_json(const std::filesystem::path& path);

/// The same of a text of at most so many bytes; `name` is used in messages.
nlohmann::json parse_json(const std::string& text, const std::string& name);

}  // namespace isonest::detail
