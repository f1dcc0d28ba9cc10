// An output that appears whole under its name or not at all.
#pragma once

#include <filesystem>

namespace isonest {

/// The temporary names for an output, in the same folder: ".NAME.partial-" and a process id.
std::filesystem::path temporary_prefix(const std::filesystem::path& path);
/// That of this process.
std::filesystem::path temporary_name(const std::filesystem::path& path);

/// Throws Error{invalid_argument} if `path` exists and `force` is false, or if it is a folder;
/// Error{not_found} if its folder does not exist.
void check_output(const std::filesystem::path& path, bool force);

/// Syncs `temporary` to disk and gives it the name `path`; without `force` an existing file of that
/// name is never replaced. Throws Error{io, invalid_argument}; then `temporary` still exists.
void publish(const std::filesystem::path& temporary, const std::filesystem::path& path, bool force);

}  // namespace isonest
