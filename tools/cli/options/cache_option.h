// Where what comes over a network is kept, as it is written on a command line.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>

namespace isonest::detail::cli {

struct CacheChoice {
    std::filesystem::path folder;
    std::uint64_t bytes = std::uint64_t{1} << 30U;  ///< at most, of the folder
};

/// "FOLDER" or "FOLDER:SIZE", as "/var/cache/scans:20G". What follows the last colon is a part of
/// the folder's name if it is no size. `option` ("--cache") starts the message. Throws
/// Error{invalid_argument} for no folder, and for a size of 0.
CacheChoice parse_cache(std::string_view option, std::string_view text);

}  // namespace isonest::detail::cli
