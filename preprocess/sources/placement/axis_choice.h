// Which axes of an n-dimensional array are the axes of the volume, and the position on the others.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/length_unit.h>
#include <isonest/open_volume.h>
#include <isonest/volume_source.h>

namespace isonest::detail {

// A common unit of length for a volume whose axes may have different units.

/// What a file says about the unit of each axis of the volume (x, y, z): none if there is no such
/// axis or it is ignored; empty if the file gives no unit.
using AxisUnits = std::array<std::optional<std::string>, 3>;

struct CommonUnit {
    std::optional<LengthUnit> unit = {};
    std::vector<std::string> notes = {};  ///< why it is unknown, or which axes were converted
    std::array<std::optional<LengthUnit>, 3> of_axis = {};  ///< set where `unit` is known

    /// Whether lengths along an axis are in the common unit; true if no unit is known.
    [[nodiscard]] bool places(std::size_t axis) const { return !unit || of_axis.at(axis); }
    /// Converts a length along an axis from its own unit to the common one; unchanged if its unit
    /// is unknown.
    [[nodiscard]] double converted(std::size_t axis, double length) const {
        return of_axis.at(axis) ? converted_length(length, *of_axis.at(axis), *unit) : length;
    }
};

/// The unit of an axis of the volume. The unit of an axis with a single node, such as a time, is
/// ignored unless it is a unit of length.
std::optional<std::string> counted_unit(std::int64_t nodes, const std::string& said);

/// If all axes have units of length, the unit of the first one. If one has another kind of unit, or
/// only some have one, the unit is unknown, and a note says why.
CommonUnit common_unit(const AxisUnits& axes);

/// An axis of an array in a file.
struct ArrayAxis {
    std::string name = {};  ///< "time", "c", "z"; empty if the file gives no name
    std::int64_t length = 1;
    /// False if its positions are different things (channels, components of a vector), so that it
    /// cannot be an axis of a volume.
    bool of_volume = true;
};

struct ChosenAxes {
    /// For x, y and z, the number of the array's axis; none where the volume is flat.
    std::array<std::optional<std::size_t>, 3> axis;
    /// The position on each of the array's axes; 0 for those of the volume.
    std::vector<std::int64_t> at;
    Int3 nodes{1, 1, 1};  ///< of the volume
    /// For x, y and z, whether the caller selected a whole axis that is not a direction in space.
    std::array<bool, 3> no_space{};
};

/// Takes `axes`, slowest first, and the caller's selection: nothing, one entry per axis, or entries
/// that name axes. A name is the one in the file, case-insensitive; a usual synonym (t and time; c,
/// channel and component) if the file has only one such axis; or the number of the axis, counted
/// from 0, or from the end if negative. An entry without a position selects the whole axis, even if
/// it is not `of_volume`. If more than three axes are left, those of length 1 are dropped. No I/O.
/// Throws Error{invalid_argument, unsupported}, whose message lists the axes and proposes an index
/// in the file's own names; `name` is used in messages.
ChosenAxes choose_axes(std::span<const ArrayAxis> axes, std::span<const AxisIndex> index,
                       const std::string& name);

/// If the chosen axes are called x, y and z, assigns them by name, whatever the order in which they
/// are stored. Otherwise returns `chosen`.
ChosenAxes by_names(const ChosenAxes& chosen, std::span<const ArrayAxis> axes);

/// Where a volume lies in an array of consecutive numbers.
struct ArrayPlace {
    Int3 nodes{1, 1, 1};
    std::optional<Int3> strides;  ///< values to the next node along x, y, z; none: no gaps
    std::uint64_t first = 0;      ///< values before node (0, 0, 0)
    std::uint64_t whole = 1;      ///< values in the whole array
};

/// choose_axes(), and the number of values to skip. `strides`: values from one position to the next
/// on each axis; empty: the last axis is the fastest and there are no gaps. Throws like
/// choose_axes(), and Error{corrupt} for an array of more than 2^60 values.
ArrayPlace place_in_array(std::span<const ArrayAxis> axes, std::span<const AxisIndex> index,
                          const std::string& name, std::span<const std::uint64_t> strides = {});

/// Notes about axes that are taken whole but are not directions in space. `apart`: the spacing
/// along x, y and z, where the axes give none.
std::vector<std::string> notes_of(const ChosenAxes& chosen, std::span<const ArrayAxis> axes,
                                  const std::optional<Double3>& apart = {});

/// Whether this is the name of an axis of times, such as "t", "time", "frame", "ocean_time".
bool is_time_name(const std::string& name);
/// The axis of times, if there is only one and the volume has one position on it.
std::optional<std::size_t> time_axis(std::span<const ArrayAxis> axes, const ChosenAxes& chosen);

/// "time 5, c 3, z 40, y 50, x 60", "5, 40, 50".
std::string text_of(std::span<const ArrayAxis> axes);

}  // namespace isonest::detail
