// An array of numbers in a file that stands in the world by an affine map: what the readers of
// medical and microscopy headers have in common.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/open_volume.h>
#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/byte_reader.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/numbers/raw_layout.h"
#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/wrapping/converted_source.h"
#include "preprocess/sources/wrapping/slice_scaled_source.h"

namespace isonest::detail {

struct PlacedArray {
    InputFile file;               ///< with the numbers
    std::string name;             ///< for messages
    std::vector<ArrayAxis> axes;  ///< slowest first
    /// Values from a position to the next on each axis; empty: the last axis is the fastest.
    std::vector<std::uint64_t> strides = {};
    bool strides_in_bytes = false;  ///< `strides` are bytes; then there are some
    RawLayout layout = {};          ///< all but nodes, strides, first, whole and the place
    /// Numbers of a type that volumes do not have; layout.type is set from it.
    std::optional<StoredNumber> stored = {};
    /// What is done to the stored numbers of the volume that `index` leaves; not with `stored`.
    std::optional<SliceScaling> scaling = {};
    /// The world's step along each of `axes`, and where the array's first value lies. None: a step
    /// of 1 along the world's axes, the fastest along x.
    std::vector<Double3> steps = {};
    Double3 first{0, 0, 0};
    /// For each of `axes` that is no direction in space the distance of its positions, if somebody
    /// takes the whole axis; 0 or none: 1.
    std::vector<double> apart = {};
    /// The caller gives a spacing: steps that are sheared are ignored, not refused.
    bool spacing_is_given = false;
    /// The user gives the spacing: of the steps only where the first sample lies is taken, and what
    /// is lost of them becomes a note.
    bool own_spacing = false;
};

/// The volume that `index` leaves of it. Axes that run backward are turned around.
/// `bytes`: what makes the array's bytes; none: they are in its file.
/// Throws as choose_axes(), place_in_world(), open_raw() and open_bytes() do.
std::unique_ptr<VolumeSource> open_placed(const PlacedArray& array,
                                          std::span<const AxisIndex> index,
                                          std::unique_ptr<ByteReader> bytes = nullptr);

}  // namespace isonest::detail
