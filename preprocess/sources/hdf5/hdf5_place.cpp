#include "preprocess/sources/hdf5/hdf5_place.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "preprocess/sources/hdf5/vtkhdf_place.h"
#include "preprocess/sources/placement/coordinates.h"
#include "store/container/hdf5_types.h"

namespace isonest::detail {
namespace {

/// Of the volume's axis: x is the last one of the shape's.
const Hdf5Axis& axis_of(const DatasetShape& shape, const std::vector<Hdf5Axis>& axes,
                        std::size_t i) {
    return axes[shape.axes[shape.axes.size() - 1 - i]];
}

/// Evenly spaced coordinates of the axes place the volume in the world.
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

/// Fiji's and ilastik's size of a voxel in micrometres, slowest axis first.
void read_element_size(hid_t dataset, const DatasetShape& shape, Hdf5Place& place) {
    if (const auto size = read_numbers(dataset, "element_size_um", 3);
        size && shape.axes.size() == 3 &&
        std::all_of(size->begin(), size->end(), [](double s) { return s > 0; })) {
        std::reverse_copy(size->begin(), size->end(), place.in_world.spacing.begin());
        place.unit = LengthUnit::micrometre;
        place.said = {true, true, true};
    }
}

/// An attribute of three numbers, x first, or of one for each axis of the volume. How many it has.
std::size_t read_three(hid_t dataset, const DatasetShape& shape, const char* name, Double3& three) {
    for (const std::size_t count : {std::size_t{3}, shape.axes.size()}) {
        if (const auto numbers = read_numbers(dataset, name, count)) {
            std::copy(numbers->begin(), numbers->end(), three.begin());
            return count;
        }
    }
    return 0;
}

/// VTK's matrix, row by row: its columns are the axes.
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
    // What is said later counts more, also of scales that are not even.
    Double3 spacing{1, 1, 1};
    const std::size_t count = read_three(of.dataset, shape, "spacing", spacing);
    SourceOptions given = options;
    if (count > 0 && !given.spacing) {
        given.spacing = spacing;
    }
    Hdf5Place place = place_of_scales(shape, nodes, axes, given, of.name);
    read_element_size(of.dataset, shape, place);
    constexpr std::size_t kMostAxesOfImage = 4;
    if (shape.axes == std::vector<std::size_t>{0, 1, 2} && shape.dims.size() <= kMostAxesOfImage) {
        std::string lost;
        if (const auto image =
                vtkhdf_place(of.file, of.path, nodes, options.spacing.has_value(), of.name, lost)) {
            place.in_world = *image;
            place.said = {true, true, true};
        }
        if (!lost.empty()) {
            place.notes.push_back(std::move(lost));
        }
    }
    for (std::size_t i = 0; i < count; ++i) {
        place.in_world.spacing.at(i) = spacing.at(i);
        place.said.at(i) = true;
    }
    read_three(of.dataset, shape, "origin", place.in_world.origin);
    read_direction(of.dataset, place.in_world.direction);
    if (const auto unit = length_unit_from(text_of_attribute(of.dataset, "unit"))) {
        place.unit = unit;
    }
    // Spacings of the user's go with axes along the world's, as open_volume() has it.
    if (const auto frame = frame_from(text_of_attribute(of.dataset, "frame"))) {
        place.frame = *frame;
    }
    return place;
}

}  // namespace isonest::detail
