#include "preprocess/sources/hdf5/hdf5_groups.h"

#include <algorithm>

#include "preprocess/sources/hdf5/hdf5_axes.h"
#include "preprocess/sources/hdf5/hdf5_files.h"

namespace isonest::detail {

std::vector<std::string> parts_of_path(const std::string& path) {
    std::vector<std::string> parts;
    for (std::size_t at = 0; at < path.size();) {
        const std::size_t end = std::min(path.find('/', at), path.size());
        if (end > at) {
            parts.push_back(path.substr(at, end - at));
        }
        at = end + 1;
    }
    return parts;
}

ObjectHandle open_inside(hid_t from, const std::string& path) {
    const QuietHdf5 quiet;
    ObjectHandle at(H5Oopen(from, ".", H5P_DEFAULT));
    for (const std::string& part : parts_of_path(path)) {
        H5L_info_t link{};
        if (!is_group(at) || H5Lexists(at.get(), part.c_str(), H5P_DEFAULT) <= 0 ||
            H5Lget_info(at.get(), part.c_str(), &link, H5P_DEFAULT) < 0 ||
            link.type != H5L_TYPE_HARD) {
            return {};
        }
        ObjectHandle next(H5Oopen(at.get(), part.c_str(), H5P_DEFAULT));
        at = std::move(next);
    }
    return at;
}

bool is_group(const ObjectHandle& object) {
    return object.valid() &&
           (H5Iget_type(object.get()) == H5I_GROUP || H5Iget_type(object.get()) == H5I_FILE);
}

bool is_dataset(const ObjectHandle& object) {
    return object.valid() && H5Iget_type(object.get()) == H5I_DATASET;
}

std::vector<std::string> names_inside(hid_t group, std::size_t most) {
    const QuietHdf5 quiet;
    std::vector<std::string> names;
    H5G_info_t info{};
    if (H5Gget_info(group, &info) < 0) {
        return names;
    }
    for (hsize_t i = 0; i < std::min<hsize_t>(info.nlinks, most); ++i) {
        const ssize_t length =
            H5Lget_name_by_idx(group, ".", H5_INDEX_NAME, H5_ITER_INC, i, nullptr, 0, H5P_DEFAULT);
        constexpr ssize_t kLongest = 4096;
        if (length <= 0 || length > kLongest) {
            continue;
        }
        std::string name(static_cast<std::size_t>(length) + 1, '\0');
        H5Lget_name_by_idx(group, ".", H5_INDEX_NAME, H5_ITER_INC, i, name.data(), name.size(),
                           H5P_DEFAULT);
        name.pop_back();
        names.push_back(std::move(name));
    }
    return names;
}

std::vector<double> numbers_inside(hid_t from, const std::string& path, std::size_t most) {
    const QuietHdf5 quiet;
    const ObjectHandle dataset = open_inside(from, path);
    if (!is_dataset(dataset) || !holds_its_values(dataset.get())) {
        return {};
    }
    const SpaceHandle space(H5Dget_space(dataset.get()));
    const TypeHandle type(H5Dget_type(dataset.get()));
    const H5T_class_t kind = H5Tget_class(type.get());
    const hssize_t count = H5Sget_simple_extent_npoints(space.get());
    if ((kind != H5T_INTEGER && kind != H5T_FLOAT) || count < 1 ||
        static_cast<std::size_t>(count) > most) {
        return {};
    }
    std::vector<double> numbers(static_cast<std::size_t>(count));
    if (H5Dread(dataset.get(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers.data()) <
        0) {
        return {};
    }
    return numbers;
}

std::string joined_text(hid_t object, const char* name) {
    constexpr std::size_t kMost = 4096;
    const QuietHdf5 quiet;
    const AttributeHandle attribute(H5Aopen(object, name, H5P_DEFAULT));
    if (!attribute.valid()) {
        return "";
    }
    const TypeHandle type(H5Aget_type(attribute.get()));
    const SpaceHandle space(H5Aget_space(attribute.get()));
    const hssize_t count = H5Sget_simple_extent_npoints(space.get());
    const std::size_t size = H5Tget_size(type.get());
    if (H5Tget_class(type.get()) != H5T_STRING || H5Tis_variable_str(type.get()) > 0 || count < 1 ||
        size < 1 || size > kMost || static_cast<std::size_t>(count) > kMost / size) {
        return text_of_attribute(object, name);
    }
    std::string text(static_cast<std::size_t>(count) * size, '\0');
    if (H5Aread(attribute.get(), type.get(), text.data()) < 0) {
        return "";
    }
    std::erase(text, '\0');
    text.erase(0, text.find_first_not_of(' '));
    text.erase(text.find_last_not_of(' ') + 1);
    return text;
}

std::optional<Double3> three_of_attribute(hid_t object, const std::string& name) {
    const std::vector<double> numbers = numbers_of_attribute(object, name);
    return numbers.size() == 3 ? std::optional(Double3{numbers[0], numbers[1], numbers[2]})
                               : std::nullopt;
}

}  // namespace isonest::detail
