// Numbers, words and JSON in headers, and file names in natural order.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace isonest::detail {

// Numbers in binary headers.

/// The number of type T at byte `at`. REQUIRES: it lies within `head`.
template <class T>
T number_at(std::string_view head, std::size_t at, bool big_endian) {
    std::array<char, sizeof(T)> bytes{};
    std::copy_n(head.begin() + static_cast<std::ptrdiff_t>(at), sizeof(T), bytes.begin());
    if (big_endian) {
        std::reverse(bytes.begin(), bytes.end());
    }
    return std::bit_cast<T>(bytes);
}

// Words that are compared without regard to case.

/// ASCII letters converted to lower case.
std::string lower(std::string_view text);

// Natural order of file names.

/// Whether a comes before b if runs of digits are compared as numbers: slice2 before slice10.
bool naturally_less(std::string_view a, std::string_view b);

/// The files (is_file_of_folder()) in a folder, without its subfolders, whose extension in lower
/// case is one of `extensions`; all files if none are given. In natural order; names that begin
/// with a dot are left out. At most kMaxFolderFiles. Throws Error{io, unsupported}.
inline constexpr std::size_t kMaxFolderFiles = 1000000;
std::vector<std::filesystem::path> files_in(const std::filesystem::path& folder,
                                            const std::vector<std::string_view>& extensions = {});

// JSON files from untrusted sources.

constexpr std::uint64_t kMaxJsonBytes = std::uint64_t{1} << 24U;

/// None if the file does not exist. Refuses files of more than kMaxJsonBytes and nesting deeper
/// than 64 levels. Numbers that JSON lacks (NaN, Infinity, -Infinity, which Python writes) become
/// strings of that name. Throws Error{corrupt, unsupported, io}.
std::optional<nlohmann::json> read_json(const std::filesystem::path& path);

/// The same for a text of up to kMaxJsonBytes; `name` is used in messages.
nlohmann::json parse_json(const std::string& text, const std::string& name);

}  // namespace isonest::detail
