// Which axes of an array of any number of axes are the volume's, and where on the others it lies.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/open_volume.h>
#include <isonest/volume_source.h>

namespace isonest::detail {

/// An axis of an array in a file.
struct ArrayAxis {
    std::string name = {};  ///< "time", "c", "z"; empty where the file names none
    std::int64_t length = 1;
    /// False: its positions are different things (channels, components of a vector), so it is no
    /// axis of a volume.
    bool of_volume = true;
};

struct ChosenAxes {
    /// For x, y and z the number of the array's axis; none where the volume is flat.
    std::array<std::optional<std::size_t>, 3> axis;
    /// For each of the array's axes the position on it; 0 for those of the volume.
    std::vector<std::int64_t> at;
    Int3 nodes{1, 1, 1};  ///< of the volume
    /// For x, y and z whether the caller took a whole axis that is no direction in space.
    std::array<bool, 3> no_space{};
};

/// Takes `axes`, slowest first, and what the caller wants of them: nothing, an entry per axis, or
/// entries that name axes. A name is the file's, in any case; one of its usual synonyms (t and
/// time; c, channel and component) where the file has one such axis; or the axis' number, from 0,
/// or negative from the end. An entry without a position takes the whole axis, also one that is not
/// `of_volume`. Of more than three axes that are left those of length 1 are dropped. No I/O.
/// Throws Error{invalid_argument, unsupported}, which list the axes and propose an index in the
/// file's own names; `name` is used in messages.
ChosenAxes choose_axes(std::span<const ArrayAxis> axes, std::span<const AxisIndex> index,
                       const std::string& name);

/// Where all axes that were chosen are called x, y and z: those, in whatever order they are stored.
/// Else as they were chosen.
ChosenAxes by_names(const ChosenAxes& chosen, std::span<const ArrayAxis> axes);

/// Where a volume lies in an array that is stored as numbers one after the other.
struct ArrayPlace {
    Int3 nodes{1, 1, 1};
    std::optional<Int3> strides;  ///< values to the next node along x, y, z; none: dense
    std::uint64_t first = 0;      ///< values before node (0, 0, 0)
    std::uint64_t whole = 1;      ///< values of the whole array
};

/// choose_axes() and the values to skip. `strides`: values from a position to the next on each
/// axis; empty: the last axis is the fastest and there are no gaps. Throws as choose_axes(), and
/// Error{corrupt} for an array of more than 2^60 values.
ArrayPlace place_in_array(std::span<const ArrayAxis> axes, std::span<const AxisIndex> index,
                          const std::string& name, std::span<const std::uint64_t> strides = {});

/// Notes about whole axes that are no directions in space. `apart`: the distance of their positions
/// along x, y and z, where the axes do not say one.
std::vector<std::string> notes_of(const ChosenAxes& chosen, std::span<const ArrayAxis> axes,
                                  const std::optional<Double3>& apart = {});

/// "time 5, c 3, z 40, y 50, x 60", "5, 40, 50".
std::string text_of(std::span<const ArrayAxis> axes);

}  // namespace isonest::detail
