#include "preprocess/sources/hdf5/hdf5_place.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string_view>
#include <vector>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/hdf5/hdf5_files.h"
#include "preprocess/sources/placement/conventions.h"
#include "preprocess/sources/placement/placement.h"
#include "store/container/parts/hdf5_types.h"
#include "store/hdf5/file_drivers.h"
#include "store/hdf5/handles.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

constexpr const char* kScaleClass = "DIMENSION_SCALE";

/// The last component of an object's path.
std::string name_of_object(hid_t object) {
    std::string name(1024, '\0');
    const ssize_t length = H5Iget_name(object, name.data(), name.size());
    if (length <= 0 || static_cast<std::size_t>(length) >= name.size()) {
        return "";
    }
    name.resize(static_cast<std::size_t>(length));
    return name.substr(name.rfind('/') + 1);
}

/// Coordinates from a scale with the axis' length; empty if it has no numbers.
std::vector<double> coordinates_of(hid_t scale, hsize_t length) {
    const SpaceHandle space(H5Dget_space(scale));
    const TypeHandle type(H5Dget_type(scale));
    const H5T_class_t kind = H5Tget_class(type.get());
    // NetCDF marks dimensions without coordinates in the scale's name. If this file is remote,
    // values in other files are not read.
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

/// Labels as h5py writes them: a list of texts of variable length.
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

/// DIMENSION_LIST contains references to the scales of each axis.
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
    constexpr hssize_t kMax = 16;
    const QuietHdf5 quiet;
    const AttributeHandle attribute(H5Aopen(object, name.c_str(), H5P_DEFAULT));
    if (!attribute.valid()) {
        return {};
    }
    const TypeHandle type(H5Aget_type(attribute.get()));
    const SpaceHandle space(H5Aget_space(attribute.get()));
    const hssize_t count = H5Sget_simple_extent_npoints(space.get());
    const H5T_class_t kind = H5Tget_class(type.get());
    if ((kind != H5T_INTEGER && kind != H5T_FLOAT) || count < 1 || count > kMax) {
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

std::optional<Placement> vtkhdf_place(hid_t file, const std::string& dataset, const Int3& nodes,
                                      bool straight, const std::string& name, std::string& lost) {
    std::string_view path = dataset;
    path.remove_prefix(path.starts_with('/') ? 1 : 0);
    const bool of_cells = path.starts_with("VTKHDF/CellData/");
    if (!of_cells && !path.starts_with("VTKHDF/PointData/")) {
        return std::nullopt;
    }
    const QuietHdf5 quiet;
    const GroupHandle group(H5Gopen2(file, "VTKHDF", H5P_DEFAULT));
    if (!group.valid() || text_of_attribute(group.get(), "Type") != "ImageData") {
        return std::nullopt;
    }
    const std::vector<double> extent = numbers_of_attribute(group.get(), "WholeExtent");
    const std::vector<double> origin = numbers_of_attribute(group.get(), "Origin");
    const std::vector<double> spacing = numbers_of_attribute(group.get(), "Spacing");
    const std::vector<double> direction = numbers_of_attribute(group.get(), "Direction");
    VtkGrid grid;
    if (extent.size() != 6 || origin.size() != 3 || spacing.size() != 3 ||
        (!direction.empty() && direction.size() != grid.direction.size())) {
        return std::nullopt;
    }
    std::copy(direction.begin(), direction.end(), grid.direction.begin());
    std::copy(spacing.begin(), spacing.end(), grid.spacing.begin());
    Double3 first{origin[0], origin[1], origin[2]};
    std::array<Double3, 3> steps{};
    for (std::size_t a = 0; a < 3; ++a) {
        const double low = extent[2 * a];
        const double high = extent[2 * a + 1];
        const bool between = of_cells && high > low;
        const auto count = static_cast<double>(nodes[static_cast<int>(a)]);
        if (high - low + (between ? 0 : 1) != count) {
            return std::nullopt;
        }
        steps.at(a) = grid.step(a);
        to_first_sample(first, steps.at(a), low, between);
    }
    if (straight) {
        Placement place;
        place.origin = first;
        lost = lost_by_own_spacing(nodes, steps);
        return place;
    }
    return place_in_world(nodes, steps, first, name);
}

namespace {

/// The axis of the volume's axis i; x is the last one of the shape.
const Hdf5Axis& axis_of(const DatasetShape& shape, const std::vector<Hdf5Axis>& axes,
                        std::size_t i) {
    return axes[shape.axes[shape.axes.size() - 1 - i]];
}

/// Places the volume by the coordinates of its axes.
Hdf5Place place_of_scales(const DatasetShape& shape, const Int3& nodes,
                          const std::vector<Hdf5Axis>& axes, const SourceOptions& options,
                          const std::string& name) {
    std::array<std::optional<AxisCoordinates>, 3> said;
    for (std::size_t i = 0; i < shape.axes.size(); ++i) {
        const Hdf5Axis& axis = axis_of(shape, axes, i);
        said.at(i) = {axis.name, axis.coordinates, axis.unit};
    }
    const CoordinatePlace by = place_by_coordinates(said, nodes, options, name);
    Hdf5Place place;
    place.unit = by.unit;
    place.notes = by.notes;
    place.said = by.said;
    place.uneven = by.uneven;
    for (std::size_t i = 0; i < 3; ++i) {
        Placement& in_world = place.in_world;
        in_world.spacing.at(i) = std::fabs(by.step.at(i));
        in_world.origin.at(i) = by.first.at(i);
        if (by.step.at(i) < 0) {
            in_world.backward.at(i) = true;
            in_world.origin.at(i) +=
                by.step.at(i) * static_cast<double>(nodes[static_cast<int>(i)] - 1);
        }
    }
    return place;
}

/// The voxel size in micrometres of Fiji and ilastik, slowest axis first.
void read_element_size(hid_t dataset, const DatasetShape& shape, Hdf5Place& place) {
    if (const auto size = read_numbers(dataset, "element_size_um", 3);
        size && shape.axes.size() == 3 &&
        std::all_of(size->begin(), size->end(), [](double s) { return s > 0; })) {
        std::reverse_copy(size->begin(), size->end(), place.in_world.spacing.begin());
        place.unit = LengthUnit::micrometre;
        place.uneven = {};
        place.said = {true, true, true};
    }
}

/// An attribute of three numbers, x first, or of one for each axis of the volume. Returns its
/// length.
std::size_t read_three(hid_t dataset, const DatasetShape& shape, const char* name, Double3& three) {
    for (const std::size_t count : {std::size_t{3}, shape.axes.size()}) {
        if (const auto numbers = read_numbers(dataset, name, count)) {
            std::copy(numbers->begin(), numbers->end(), three.begin());
            return count;
        }
    }
    return 0;
}

/// VTK's matrix, row by row; its columns are the axes.
void read_direction(hid_t dataset, Directions& direction) {
    if (const auto numbers = read_numbers(dataset, "direction", 9)) {
        for (std::size_t i = 0; i < 9; ++i) {
            direction.at(i % 3).at(i / 3) = (*numbers)[i];
        }
    }
}

}  // namespace

Hdf5Place hdf5_place(const NamedDataset& of, const DatasetShape& shape,
                     const std::vector<Hdf5Axis>& axes, const SourceOptions& options) {
    const Int3 nodes = shape.along_axes(shape.dims);
    // Later sources override earlier ones, also scales that are not evenly spaced.
    Double3 spacing{1, 1, 1};
    const std::size_t count = read_three(of.dataset, shape, "spacing", spacing);
    SourceOptions given = options;
    if (count > 0 && !given.spacing) {
        given.spacing = spacing;
    }
    Hdf5Place place = place_of_scales(shape, nodes, axes, given, of.name);
    read_element_size(of.dataset, shape, place);
    constexpr std::size_t kMaxAxesOfImage = 4;
    if (shape.axes == std::vector<std::size_t>{0, 1, 2} && shape.dims.size() <= kMaxAxesOfImage) {
        std::string lost;
        if (const auto image =
                vtkhdf_place(of.file, of.path, nodes, options.spacing.has_value(), of.name, lost)) {
            place.in_world = *image;
            place.uneven = {};
            place.said = {true, true, true};
        }
        if (!lost.empty()) {
            place.notes.push_back(std::move(lost));
        }
    }
    for (std::size_t i = 0; i < count; ++i) {
        place.in_world.spacing.at(i) = spacing.at(i);
        place.uneven.at(i).clear();
        place.said.at(i) = true;
    }
    const std::size_t given_origin = read_three(of.dataset, shape, "origin", place.in_world.origin);
    for (std::size_t a = 0; a < std::min<std::size_t>(given_origin, 3); ++a) {
        std::vector<double>& at = place.uneven.at(a);
        const double first = at.empty() ? 0 : std::min(at.front(), at.back());
        for (double& x : at) {
            x += place.in_world.origin.at(a) - first;
        }
    }
    read_direction(of.dataset, place.in_world.direction);
    if (place.in_world.direction != kAlongWorld) {
        place.uneven = {};
    }
    if (const auto unit = length_unit_from(text_of_attribute(of.dataset, "unit"))) {
        place.unit = unit;
    }
    // A spacing given by the user implies axes along the world's, as in open_volume().
    if (const auto frame = frame_from(text_of_attribute(of.dataset, "frame"))) {
        place.frame = *frame;
    }
    return place;
}

std::optional<CfPositions> hdf5_positions(const NamedDataset& of, const Int3& nodes) {
    if (std::min({nodes.x, nodes.y, nodes.z}) < 2) {
        return std::nullopt;
    }
    const QuietHdf5 quiet;
    const std::string group = of.path.substr(0, of.path.rfind('/') + 1);
    std::vector<CfCoordinate> named;
    for (const std::string& word : words_of(text_of_attribute(of.dataset, "coordinates"))) {
        const std::string path = word.starts_with('/') ? word : group + word;
        const ObjectHandle found = open_inside(of.file, path);
        if (!found.valid() || !is_dataset(found)) {
            continue;
        }
        const auto text = [&](const char* attribute) {
            return text_of_attribute(found.get(), attribute);
        };
        CfCoordinate& c = named.emplace_back(CfCoordinate{
            path, {}, text("units"), text("standard_name"), text("axis"), text("positive")});
        for (const hsize_t length : shape_of(found.get()).dims) {
            c.lengths.push_back(static_cast<std::int64_t>(length));
        }
    }
    return choose_positions(named, nodes);
}

}  // namespace isonest::detail
