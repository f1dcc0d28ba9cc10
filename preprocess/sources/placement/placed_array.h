// An array of numbers in a file with an affine map to the world: the common part of the readers of
// medical and microscopy headers.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/open_volume.h>
#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/numbers/raw_rows.h"
#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/wrapping/scaled_source.h"

namespace isonest::detail {

struct PlacedArray {
    InputFile file;               ///< the file with the numbers
    std::string name;             ///< for messages
    std::vector<ArrayAxis> axes;  ///< slowest first
    /// Values from one position to the next on each axis; empty: the last axis is the fastest.
    std::vector<std::uint64_t> strides = {};
    bool strides_in_bytes = false;  ///< `strides` are in bytes; then they are not empty
    /// Everything except nodes, strides, first, whole and the place.
    RawLayout layout = {};
    /// Numbers of a type that volumes do not have; layout.type is then set from it.
    std::optional<StoredNumber> stored = {};
    /// Scaling of the stored numbers of the volume that `index` leaves; not together with `stored`.
    std::optional<SliceScaling> scaling = {};
    /// The step along each of `axes` in world coordinates, and the place of the array's first
    /// value. Empty: steps of 1 along the world's axes, the fastest along x.
    std::vector<Double3> steps = {};
    Double3 first{0, 0, 0};
    /// For each of `axes` that is not a direction in space, the distance of its positions, for when
    /// the whole axis is selected; 0 or empty: 1.
    std::vector<double> apart = {};
    /// The caller gives a spacing: sheared or invalid steps are ignored.
    bool spacing_is_given = false;
    /// The user gives the spacing: only the place of the first sample is taken from the steps, and
    /// a note says which of their information is ignored.
    bool own_spacing = false;
};

/// The volume that `index` selects from the array. Axes that run backward are reversed.
/// `bytes`: makes the array's bytes; null: they are in its file.
/// Throws like choose_axes(), place_in_world(), open_raw() and open_bytes().
std::unique_ptr<VolumeSource> open_placed(const PlacedArray& array,
                                          std::span<const AxisIndex> index,
                                          std::unique_ptr<ByteReader> bytes = nullptr);

/// Sets `steps` and `first` of the array of a rectilinear grid, whose first three axes are z, y and
/// x, from the coordinates of the grid's points. `points`: their numbers along x, y and z. `read`:
/// gives the coordinates along one of these; called only for axes of the volume that are not too
/// long for one. `of_cells`: the values lie between the points. Throws like
/// place_by_coordinates() and choose_axes().
CoordinatePlace place_rectilinear(
    PlacedArray& array, const std::array<std::int64_t, 3>& points, bool of_cells,
    const SourceOptions& options,
    const std::function<std::vector<double>(std::size_t along)>& read);

}  // namespace isonest::detail
