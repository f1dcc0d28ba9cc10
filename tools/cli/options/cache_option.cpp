#include "tools/cli/options/cache_option.h"

#include <fmt/format.h>

#include <isonest/error.h>

#include "tools/cli/options/units.h"

namespace isonest::detail::cli {

CacheChoice parse_cache(std::string_view option, std::string_view text) {
    CacheChoice choice;
    std::string_view folder = text;
    if (const std::size_t colon = text.rfind(':'); colon != std::string_view::npos) {
        try {
            choice.bytes = parse_bytes(option, text.substr(colon + 1));
            folder = text.substr(0, colon);
        } catch (const Error&) {
            folder = text;
        }
    }
    if (folder.empty() || choice.bytes == 0) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} '{}': give FOLDER or FOLDER:SIZE, like cache:2G, and a size "
                                "above 0",
                                option, text));
    }
    choice.folder = folder;
    return choice;
}

}  // namespace isonest::detail::cli
