// The page, as files inside of the program (made by the build from tools/view/web).
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace isonest::detail::view {

struct PageFile {
    std::string_view type;   ///< MIME
    std::string_view bytes;  ///< live as long as the program
};

/// "/" and "/main.js"; nothing for what is none of the page's.
std::optional<PageFile> page_file(std::string_view path);

}  // namespace isonest::detail::view
