// What a killed run left behind.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace isonest::detail::cli {

/// Names the temporary files of `output` whose run is over, and how to remove them; empty if there
/// are none. Deletes nothing.
std::string leftovers_of(const std::filesystem::path& output);
/// The same for several outputs.
std::string leftovers_of(const std::vector<std::filesystem::path>& outputs);

}  // namespace isonest::detail::cli
