// The datasets of an HDF5 file that are volumes. Private to preprocess.
#pragma once

#include <hdf5.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/value_type.h>

namespace isonest::detail {

/// The value type that holds the dataset's numbers: integers, also under names (an enumeration,
/// h5py's bool), and floating point numbers of up to 64 bits; else none. Integers of more than 32
/// bits are float64, which cannot hold all of them.
std::optional<ValueType> value_type_of(hid_t dataset);

struct DatasetShape {
    std::vector<hsize_t> dims;      ///< as in the file, slowest first
    std::vector<std::size_t> axes;  ///< those of `dims` that are the volume's, x last: 1 to 3; none
                                    ///< if the dataset has more than 3 longer than 1, or no axis
    std::vector<hsize_t> at;        ///< for the other dims the position; none: 0
    [[nodiscard]] std::string text() const;
    /// Of numbers along `dims`, those along x, y and z; 1 along axes that are not there.
    [[nodiscard]] Int3 along_axes(const std::vector<hsize_t>& numbers) const;
    /// And back: `otherwise` along the dims that are no axis.
    [[nodiscard]] std::vector<hsize_t> along_dims(const Int3& numbers, hsize_t otherwise) const;
    /// A node's place in the dataset.
    [[nodiscard]] std::vector<hsize_t> place_of(const Int3& node) const;
};
DatasetShape shape_of(hid_t dataset);

/// Where the numbers of a contiguous dataset begin in its file; HADDR_UNDEF if none were written.
haddr_t offset_of_values(hid_t dataset);
/// How many bytes the chunk that begins at the element takes in its file: 0 if it was never
/// written, none if HDF5 cannot say, and then hdf5_message() says why.
std::optional<hsize_t> stored_size_of_chunk(hid_t dataset, const std::vector<hsize_t>& at);

/// The path of the dataset to read where none is named: the only one of those with the most axes,
/// coordinates of axes left out. Where none has 3, or `indexed`, the only one of more than 3.
/// Throws Error{not_found, invalid_argument, corrupt}, listing what the file has.
std::string choose_dataset(hid_t file, const std::filesystem::path& path, bool indexed);

/// What the file has, a line each, for messages. Throws Error{corrupt}.
std::string list_of_datasets(hid_t file, const std::filesystem::path& path);

}  // namespace isonest::detail
