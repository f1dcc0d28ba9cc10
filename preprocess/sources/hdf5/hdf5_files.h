// Finds the files that contain an HDF5 dataset's values. Private to preprocess.
#pragma once

#include <hdf5.h>

#include <filesystem>
#include <string>
#include <vector>

#include "store/hdf5/handles.h"

namespace isonest::detail {

/// The paths where HDF5 looks for a file that another file names, in its order; the first that it
/// can open is used. `variable` is the environment variable with the list of folders for this kind
/// of name.
std::vector<std::filesystem::path> places_of(const std::filesystem::path& name,
                                             const std::filesystem::path& file,
                                             const char* variable);

/// Opens a dataset by its path, through links of all kinds, and appends the files reached by
/// external links to `files`. Invalid if there is none; then `reason` says why. Throws
/// Error{invalid_argument} if a link leads to something other than a regular file, which could
/// hang.
DatasetHandle open_dataset(hid_t file, const std::string& path, const PropertyHandle& access,
                           std::vector<std::filesystem::path>& files,
                           std::string* reason = nullptr);

/// The same for a remote file (is_of_bytes()). Throws Error{unsupported} if a link leads to another
/// file; it is not opened, neither locally nor remotely.
DatasetHandle open_remote_dataset(hid_t file, const std::string& path, const PropertyHandle& access,
                                  std::string* reason = nullptr);

/// Whether a dataset's values are in its own file: no external storage, not virtual.
bool holds_its_values(hid_t dataset);

/// The file that contains a dataset, which may have been reached by external links.
std::filesystem::path file_of(hid_t dataset);

/// All files that contain a dataset's values or say where they are: its own file, external storage,
/// and for a virtual dataset its source files, including those whose names are patterns
/// ("part-%b.h5"), and their files in turn. If a part is missing, HDF5 silently returns the fill
/// value or zeros; this function throws Error{not_found} naming the first missing source or
/// storage, Error{corrupt} for storage or a source that is too short, or a virtual dataset that is
/// its own source, and Error{invalid_argument} for something other than a regular file. `name` is
/// the dataset's, for messages.
void add_files_of(hid_t dataset, const std::string& name,
                  std::vector<std::filesystem::path>& files);

}  // namespace isonest::detail
