// Groups and small datasets of a file that say what another dataset means. Private to preprocess.
#pragma once

#include <hdf5.h>

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>

#include "store/hdf5/handles.h"

namespace isonest::detail {

using ObjectHandle = Handle<H5Oclose>;

/// A group or dataset below `from` that hard links lead to: never in another file. Invalid if there
/// is none.
ObjectHandle open_inside(hid_t from, const std::string& path);
bool is_group(const ObjectHandle& object);
bool is_dataset(const ObjectHandle& object);

/// The names in a group, sorted, up to `most`.
std::vector<std::string> names_inside(hid_t group, std::size_t most);

/// The numbers of a dataset, in its order. None if they are not there, are no numbers, are more
/// than `most`, or lie in other files.
std::vector<double> numbers_inside(hid_t from, const std::string& path, std::size_t most);

/// An attribute of letters, one text each, put together (Imaris), or of one text of fixed length;
/// empty if there is none.
std::string joined_text(hid_t object, const char* name);

/// Three numbers of an attribute.
std::optional<Double3> three_of_attribute(hid_t object, const std::string& name);

/// "/a/b/" as {"a", "b"}.
std::vector<std::string> parts_of_path(const std::string& path);

}  // namespace isonest::detail
