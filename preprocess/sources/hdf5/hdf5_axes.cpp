#include "preprocess/sources/hdf5/hdf5_axes.h"

#include <algorithm>

#include "preprocess/sources/bytes/lower_case.h"
#include "preprocess/sources/hdf5/hdf5_files.h"
#include "store/container/hdf5_types.h"
#include "store/hdf5/bytes_driver.h"
#include "store/hdf5/handles.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

constexpr const char* kScaleClass = "DIMENSION_SCALE";

/// The last part of an object's path.
std::string name_of_object(hid_t object) {
    std::string name(1024, '\0');
    const ssize_t length = H5Iget_name(object, name.data(), name.size());
    if (length <= 0 || static_cast<std::size_t>(length) >= name.size()) {
        return "";
    }
    name.resize(static_cast<std::size_t>(length));
    return name.substr(name.rfind('/') + 1);
}

/// Coordinates of a scale of the axis' length; nothing if they are not numbers.
std::vector<double> coordinates_of(hid_t scale, hsize_t length) {
    const SpaceHandle space(H5Dget_space(scale));
    const TypeHandle type(H5Dget_type(scale));
    const H5T_class_t kind = H5Tget_class(type.get());
    // NetCDF's dimensions without coordinates say so in the scale's name.
    // Values in other files are not read where this one is elsewhere.
    if ((is_of_bytes(scale) && !holds_its_values(scale)) ||
        text_of_attribute(scale, "NAME").starts_with("This is a netCDF dimension but not") ||
        (kind != H5T_INTEGER && kind != H5T_FLOAT) ||
        H5Sget_simple_extent_ndims(space.get()) != 1 ||
        H5Sget_simple_extent_npoints(space.get()) != static_cast<hssize_t>(length) ||
        length > static_cast<hsize_t>(kMaxNodesPerAxis)) {
        return {};
    }
    std::vector<double> numbers(length);
    if (H5Dread(scale, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers.data()) < 0) {
        return {};
    }
    if (kind == H5T_INTEGER && is_said_unsigned(scale)) {
        take_as_unsigned(numbers, H5Tget_size(type.get()));
    }
    unpack(numbers, [&](const std::string& name) { return numbers_of_attribute(scale, name); });
    return numbers;
}

/// Labels that h5py writes: a list of texts of variable length.
std::vector<std::string> labels_of(hid_t dataset, std::size_t count) {
    std::vector<std::string> labels(count);
    const AttributeHandle attribute(H5Aopen(dataset, "DIMENSION_LABELS", H5P_DEFAULT));
    if (!attribute.valid()) {
        return labels;
    }
    const TypeHandle type(H5Aget_type(attribute.get()));
    const SpaceHandle space(H5Aget_space(attribute.get()));
    if (H5Tis_variable_str(type.get()) <= 0 ||
        H5Sget_simple_extent_npoints(space.get()) != static_cast<hssize_t>(count)) {
        return labels;
    }
    std::vector<char*> texts(count, nullptr);
    if (H5Aread(attribute.get(), type.get(), static_cast<void*>(texts.data())) >= 0) {
        for (std::size_t i = 0; i < count; ++i) {
            labels[i] = texts[i] == nullptr ? "" : texts[i];
            H5free_memory(texts[i]);
        }
    }
    return labels;
}

/// DIMENSION_LIST has for each axis the references to its scales.
void read_scales(hid_t dataset, const std::vector<hsize_t>& dims, std::vector<Hdf5Axis>& axes) {
    const AttributeHandle attribute(H5Aopen(dataset, "DIMENSION_LIST", H5P_DEFAULT));
    if (!attribute.valid()) {
        return;
    }
    const TypeHandle type(H5Aget_type(attribute.get()));
    const SpaceHandle space(H5Aget_space(attribute.get()));
    const TypeHandle wanted(H5Tvlen_create(H5T_STD_REF_OBJ));
    if (H5Tget_class(type.get()) != H5T_VLEN || H5Tequal(type.get(), wanted.get()) <= 0 ||
        H5Sget_simple_extent_npoints(space.get()) != static_cast<hssize_t>(dims.size())) {
        return;
    }
    std::vector<hvl_t> lists(dims.size());
    if (H5Aread(attribute.get(), wanted.get(), lists.data()) < 0) {
        return;
    }
    for (std::size_t i = 0; i < dims.size(); ++i) {
        if (lists[i].len < 1 || lists[i].p == nullptr) {
            continue;
        }
        const DatasetHandle scale(H5Rdereference2(dataset, H5P_DEFAULT, H5R_OBJECT, lists[i].p));
        if (!scale.valid() || H5Iget_type(scale.get()) != H5I_DATASET) {
            continue;
        }
        axes[i].name = name_of_object(scale.get());
        axes[i].coordinates = coordinates_of(scale.get(), dims[i]);
        axes[i].unit = text_of_attribute(scale.get(), "units");
    }
    H5Dvlen_reclaim(wanted.get(), space.get(), H5P_DEFAULT, lists.data());
}

}  // namespace

std::string text_of_attribute(hid_t object, const char* name) {
    const QuietHdf5 quiet;
    if (const auto fixed = read_text(object, name)) {
        return *fixed;
    }
    const AttributeHandle attribute(H5Aopen(object, name, H5P_DEFAULT));
    if (!attribute.valid()) {
        return "";
    }
    const TypeHandle type(H5Aget_type(attribute.get()));
    const SpaceHandle space(H5Aget_space(attribute.get()));
    char* text = nullptr;
    if (H5Tis_variable_str(type.get()) <= 0 || H5Sget_simple_extent_npoints(space.get()) != 1 ||
        H5Aread(attribute.get(), type.get(), static_cast<void*>(&text)) < 0 || text == nullptr) {
        return "";
    }
    std::string out = text;
    H5free_memory(text);
    return out;
}

std::vector<Hdf5Axis> hdf5_axes(hid_t dataset, const std::vector<hsize_t>& dims) {
    const QuietHdf5 quiet;
    std::vector<Hdf5Axis> axes(dims.size());
    read_scales(dataset, dims, axes);
    const std::vector<std::string> labels = labels_of(dataset, dims.size());
    for (std::size_t i = 0; i < axes.size(); ++i) {
        if (axes[i].name.empty()) {
            axes[i].name = labels[i];
        }
    }
    return axes;
}

bool is_dimension_scale(hid_t dataset) {
    return text_of_attribute(dataset, "CLASS") == kScaleClass;
}

std::vector<double> numbers_of_attribute(hid_t object, const std::string& name) {
    constexpr hssize_t kMost = 16;
    const QuietHdf5 quiet;
    const AttributeHandle attribute(H5Aopen(object, name.c_str(), H5P_DEFAULT));
    if (!attribute.valid()) {
        return {};
    }
    const TypeHandle type(H5Aget_type(attribute.get()));
    const SpaceHandle space(H5Aget_space(attribute.get()));
    const hssize_t count = H5Sget_simple_extent_npoints(space.get());
    const H5T_class_t kind = H5Tget_class(type.get());
    if ((kind != H5T_INTEGER && kind != H5T_FLOAT) || count < 1 || count > kMost) {
        return {};
    }
    std::vector<double> numbers(static_cast<std::size_t>(count));
    if (H5Aread(attribute.get(), H5T_NATIVE_DOUBLE, numbers.data()) < 0) {
        return {};
    }
    return numbers;
}

bool is_said_unsigned(hid_t dataset) {
    return lower(text_of_attribute(dataset, "_Unsigned")) == "true";
}

}  // namespace isonest::detail
