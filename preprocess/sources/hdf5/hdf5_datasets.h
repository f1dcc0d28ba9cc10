// The datasets of an HDF5 file that are volumes. Private to preprocess.
#pragma once

#include <hdf5.h>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/value_type.h>

#include "store/hdf5/handles.h"

namespace isonest::detail {

// Groups and small datasets of a file that describe another dataset.

using ObjectHandle = Handle<H5Oclose>;

/// A group or dataset below `from` that is reached by hard links, so never in another file. Invalid
/// if there is none.
ObjectHandle open_inside(hid_t from, const std::string& path);
bool is_group(const ObjectHandle& object);
bool is_dataset(const ObjectHandle& object);

/// The names in a group, sorted, at most `most`.
std::vector<std::string> names_inside(hid_t group, std::size_t most);

/// The numbers of a dataset, in its order. Empty if it does not exist, is not numeric, has more
/// than `most` numbers, or stores them in other files.
std::vector<double> numbers_inside(hid_t from, const std::string& path, std::size_t most);

/// An attribute that is an array of letters, joined (Imaris), or one text of fixed length; empty if
/// there is none.
std::string joined_text(hid_t object, const char* name);

/// Three numbers of an attribute.
std::optional<Double3> three_of_attribute(hid_t object, const std::string& name);

/// Splits "/a/b/" into {"a", "b"}.
std::vector<std::string> parts_of_path(const std::string& path);

/// The value type that holds the dataset's numbers: integers, also as named types (an enumeration,
/// h5py's bool), and floating point numbers of up to 64 bits; otherwise none. Integers of more than
/// 32 bits become float64, which cannot represent all of them.
std::optional<ValueType> value_type_of(hid_t dataset);

struct DatasetShape {
    std::vector<hsize_t> dims;  ///< as in the file, slowest first
    /// Those of `dims` that are the volume's, x last: 1 to 3; none if the dataset has no axis, or
    /// more than 3 longer than 1.
    std::vector<std::size_t> axes;
    std::vector<hsize_t> at;  ///< position on each of the other dims; empty: 0
    [[nodiscard]] std::string text() const;
    /// Selects x, y and z from numbers along `dims`; 1 for axes that do not exist.
    [[nodiscard]] Int3 along_axes(const std::vector<hsize_t>& numbers) const;
    /// The inverse: `otherwise` for the dims that are not axes.
    [[nodiscard]] std::vector<hsize_t> along_dims(const Int3& numbers, hsize_t otherwise) const;
    /// The position of a node in the dataset.
    [[nodiscard]] std::vector<hsize_t> place_of(const Int3& node) const;
};
DatasetShape shape_of(hid_t dataset);

/// File offset of the numbers of a contiguous dataset; HADDR_UNDEF if none were written.
haddr_t offset_of_values(hid_t dataset);
/// Bytes in the file of the chunk that begins at this element: 0 if it was never written; none if
/// HDF5 cannot tell, and then hdf5_message() says why.
std::optional<hsize_t> stored_size_of_chunk(hid_t dataset, const std::vector<hsize_t>& at);

/// The path of the dataset to read if none is named: the only one among those with the most axes,
/// excluding coordinates of axes. If none has 3 axes, or if `indexed`, the only one with more than
/// 3. Throws Error{not_found, invalid_argument, corrupt}, listing the datasets of the file.
std::string choose_dataset(hid_t file, const std::filesystem::path& path, bool indexed);

/// The datasets of the file, one per line, for messages. Throws Error{corrupt}.
std::string list_of_datasets(hid_t file, const std::filesystem::path& path);

}  // namespace isonest::detail
