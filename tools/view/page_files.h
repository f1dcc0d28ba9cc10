// The page, as files inside of the program (made by the build from tools/view/web).
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace isonest::detail::view {

struct PageFile {
    std::string_view type;   ///< MIME
    std::string_view bytes;  ///< live as long as the program
};

/// "/" and "/main.js"; nothing for what is none of the page's.
std::optional<PageFile> page_file(std::string_view path);

struct NamedPageFile {
    std::string_view path;  ///< "/main.js"
    PageFile file;
};
/// All of them, by their names.
std::vector<NamedPageFile> page_files();

}  // namespace isonest::detail::view
