// Which files an HDF5 dataset's values come from. Private to preprocess.
#pragma once

#include <hdf5.h>

#include <filesystem>
#include <string>
#include <vector>

#include "store/hdf5/handles.h"

namespace isonest::detail {

/// Where HDF5 looks for a file that is named in another one, in its order, the first that it can
/// open counts. `variable` is the environment's list of folders for this kind of name.
std::vector<std::filesystem::path> places_of(const std::filesystem::path& name,
                                             const std::filesystem::path& file,
                                             const char* variable);

/// Opens a dataset by its path, through links of all kinds, and adds the files whose external links
/// were followed to `files`. Invalid if there is none; then `reason` says why. Throws
/// Error{invalid_argument} if a link leads to what is not a regular file, which could hang.
DatasetHandle open_dataset(hid_t file, const std::string& path, const PropertyHandle& access,
                           std::vector<std::filesystem::path>& files,
                           std::string* reason = nullptr);

/// The same of a file elsewhere (is_of_bytes()): throws Error{unsupported} where a link leads to
/// another file, which is not opened, neither here nor there.
DatasetHandle open_far_dataset(hid_t file, const std::string& path, const PropertyHandle& access,
                               std::string* reason = nullptr);

/// Whether a dataset's values lie in its own file: it has no external storage, and is not virtual.
bool holds_its_values(hid_t dataset);

/// The file that holds a dataset, which external links may have led to.
std::filesystem::path file_of(hid_t dataset);

/// All files that hold a dataset's values or say where they are: its own, external storage, and
/// for a virtual dataset its sources', with those whose names are patterns ("part-%b.h5"), and
/// theirs in turn. Where a part is not there, HDF5 gives the fill value or zeros and says nothing:
/// throws Error{not_found} naming the first such source or storage, Error{corrupt} for storage or a
/// source that is too short, or a virtual dataset that is its own source, and
/// Error{invalid_argument} for what is not a regular file. `name` is the dataset's, for messages.
void add_files_of(hid_t dataset, const std::string& name,
                  std::vector<std::filesystem::path>& files);

}  // namespace isonest::detail
