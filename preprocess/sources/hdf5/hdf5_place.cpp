#include "preprocess/sources/hdf5/hdf5_place.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "preprocess/sources/hdf5/vtkhdf_place.h"
#include "preprocess/sources/placement/axis_units.h"
#include "store/container/hdf5_types.h"

namespace isonest::detail {
namespace {

/// Of the volume's axis: x is the last one of the shape's.
const Hdf5Axis& axis_of(const DatasetShape& shape, const std::vector<Hdf5Axis>& axes,
                        std::size_t i) {
    return axes[shape.axes[shape.axes.size() - 1 - i]];
}

/// Axes that coordinates do not place have none.
AxisUnits units_of_axes(const DatasetShape& shape, const Int3& nodes,
                        const std::vector<Hdf5Axis>& axes) {
    AxisUnits units;
    for (std::size_t i = 0; i < shape.axes.size(); ++i) {
        const Hdf5Axis& axis = axis_of(shape, axes, i);
        const bool placed = axis.even && axis.even->step != 0;
        units.at(i) = counted_unit(nodes[static_cast<int>(i)], placed ? axis.unit : "");
    }
    return units;
}

/// Evenly spaced coordinates of the axes place the volume in the world.
Hdf5Place place_by_coordinates(const DatasetShape& shape, const Int3& nodes,
                               const std::vector<Hdf5Axis>& axes) {
    Hdf5Place place;
    const CommonUnit common = common_unit(units_of_axes(shape, nodes, axes));
    for (std::size_t i = 0; i < shape.axes.size(); ++i) {
        const Hdf5Axis& axis = axis_of(shape, axes, i);
        if (axis.uneven) {
            place.notes.push_back(fmt::format(
                "the coordinates '{}' are not evenly spaced: the nodes are placed 1 apart",
                axis.name));
        }
        if (!axis.even || axis.even->step == 0 || !common.places(i)) {
            continue;
        }
        const std::int64_t count = nodes[static_cast<int>(i)];
        // One node alone has no spacing.
        const double step = count == 1 ? 1 : common.converted(i, axis.even->step);
        Placement& in_world = place.in_world;
        in_world.spacing.at(i) = std::fabs(step);
        in_world.origin.at(i) = common.converted(i, axis.even->first);
        if (step < 0) {
            in_world.backward.at(i) = true;
            in_world.origin.at(i) += step * static_cast<double>(count - 1);
        }
    }
    place.unit = common.unit;
    place.notes.insert(place.notes.end(), common.notes.begin(), common.notes.end());
    return place;
}

/// Fiji's and ilastik's size of a voxel in micrometres, slowest axis first.
void read_element_size(hid_t dataset, const DatasetShape& shape, Hdf5Place& place) {
    if (const auto size = read_numbers(dataset, "element_size_um", 3);
        size && shape.axes.size() == 3 &&
        std::all_of(size->begin(), size->end(), [](double s) { return s > 0; })) {
        std::reverse_copy(size->begin(), size->end(), place.in_world.spacing.begin());
        place.unit = LengthUnit::micrometre;
    }
}

/// An attribute of three numbers, x first, or of one for each axis of the volume.
void read_three(hid_t dataset, const DatasetShape& shape, const char* name, Double3& three) {
    for (const std::size_t count : {std::size_t{3}, shape.axes.size()}) {
        if (const auto numbers = read_numbers(dataset, name, count)) {
            std::copy(numbers->begin(), numbers->end(), three.begin());
            return;
        }
    }
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
                     const std::vector<Hdf5Axis>& axes, bool straight) {
    const Int3 nodes = shape.along_axes(shape.dims);
    Hdf5Place place = place_by_coordinates(shape, nodes, axes);
    read_element_size(of.dataset, shape, place);
    constexpr std::size_t kMostAxesOfImage = 4;
    if (shape.axes == std::vector<std::size_t>{0, 1, 2} && shape.dims.size() <= kMostAxesOfImage) {
        place.in_world =
            vtkhdf_place(of.file, of.path, nodes, straight, of.name).value_or(place.in_world);
    }
    read_three(of.dataset, shape, "spacing", place.in_world.spacing);
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
