// Where a volume lies whose axes have coordinates: one number for each node of an axis.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/length_unit.h>
#include <isonest/open_volume.h>

namespace isonest::detail {

/// What a file says of an axis of the volume.
struct AxisCoordinates {
    std::string name = {};             ///< for messages
    std::vector<double> numbers = {};  ///< one for each node; none: the file has none
    std::string unit = {};             ///< of the numbers; empty: the file does not say
};

struct CoordinatePlace {
    Double3 step{1, 1, 1};       ///< from a node to the next; negative: the coordinates run down
    Double3 first{0, 0, 0};      ///< where node 0 lies
    std::array<bool, 3> said{};  ///< whether coordinates say the step
    std::optional<LengthUnit> unit = {};
    std::vector<std::string> notes = {};
};

/// Along x, y and z: none where the volume has no such axis. Evenly spaced coordinates place it,
/// converted to one unit of length (axis_units.h). Coordinates that are finite and not all the same
/// may differ from even ones by up to a tenth of their mean step; where that is more than rounding
/// to float32 or a thousandth explains, a note says by how much. Where they differ more,
/// Error{unsupported} is thrown, which says their mean spacing, unless the caller gives a spacing;
/// then a note says how far from their coordinates the nodes lie. `name` is for messages.
CoordinatePlace place_by_coordinates(const std::array<std::optional<AxisCoordinates>, 3>& axes,
                                     const Int3& nodes, const SourceOptions& options,
                                     const std::string& name);

}  // namespace isonest::detail
