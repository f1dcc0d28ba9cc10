// One unit of length for a volume whose axes may have one each.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <isonest/length_unit.h>

namespace isonest::detail {

/// What a file says of the unit of an axis of the volume (x, y, z): nothing where there is no such
/// axis, or it does not count; empty where the file does not say.
using AxisUnits = std::array<std::optional<std::string>, 3>;

struct CommonUnit {
    std::optional<LengthUnit> unit = {};
    std::vector<std::string> notes = {};  ///< why it is not known, or that axes were converted
    std::array<std::optional<LengthUnit>, 3> of_axis = {};  ///< where `unit` is known

    /// Whether lengths along an axis are in the common unit, or nothing is known of units.
    [[nodiscard]] bool places(std::size_t axis) const { return !unit || of_axis.at(axis); }
    /// A length along an axis, from its own unit to the common one; as it is where that is not
    /// known.
    [[nodiscard]] double converted(std::size_t axis, double length) const {
        return of_axis.at(axis) ? converted_length(length, *of_axis.at(axis), *unit) : length;
    }
};

/// What an axis of the volume says: one of a single node, such as a time, counts only if its unit
/// is one of length.
std::optional<std::string> counted_unit(std::int64_t nodes, const std::string& said);

/// Where all axes have units of length, that of the first one. Where one has another unit, or only
/// some have one, the unit is not known, and a note says why.
CommonUnit common_unit(const AxisUnits& axes);

}  // namespace isonest::detail
