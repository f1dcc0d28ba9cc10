// The page's files, embedded in the program (made by the build from tools/view/web).
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace isonest::detail::view {

struct PageFile {
    std::string_view type;   ///< MIME
    std::string_view bytes;  ///< valid as long as the program runs
};

/// "/" and "/main.js"; none for paths that are not the page's.
std::optional<PageFile> page_file(std::string_view path);

struct NamedPageFile {
    std::string_view path;  ///< "/main.js"
    PageFile file;
};
/// All files, by name.
std::vector<NamedPageFile> page_files();

}  // namespace isonest::detail::view
