// The order of file names as people count.
#pragma once

#include <filesystem>
#include <string_view>
#include <vector>

namespace isonest::detail {

/// Whether a comes before b where runs of digits are numbers: slice2 before slice10.
bool naturally_less(std::string_view a, std::string_view b);

/// The files (is_file_of_folder()) in a folder, not in its subfolders, whose extension, in lower
/// case, is one of `extensions`; all where there are none given. In natural order; names that begin
/// with a dot are left out. At most kMostFolderFiles. Throws Error{io, unsupported}.
inline constexpr std::size_t kMostFolderFiles = 1000000;
std::vector<std::filesystem::path> files_in(const std::filesystem::path& folder,
                                            const std::vector<std::string_view>& extensions = {});

}  // namespace isonest::detail
