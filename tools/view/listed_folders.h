// Folders of files that wait to be sent, for when a signal ends the program.
#pragma once

#include <filesystem>

namespace isonest::detail::view {

/// Remembers a folder that remove_listed_folders() removes, as long as it is there; beyond 192 that
/// are there at once none is remembered. Not thread-safe.
void list_folder(const std::filesystem::path& folder);

/// Removes what was listed, with the files in it. Async-signal-safe; for the program's end.
void remove_listed_folders();

}  // namespace isonest::detail::view
