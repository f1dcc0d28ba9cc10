#include "store/container/extent.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "store/base/hypot3.h"

namespace isonest::detail {

std::string why_no_place(const Int3& nodes, const Double3& spacing, const Double3& origin) {
    const std::string given = fmt::format("spacing {} {} {} and origin {} {} {}", spacing[0],
                                          spacing[1], spacing[2], origin[0], origin[1], origin[2]);
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const double last = origin[a] + spacing[a] * static_cast<double>(nodes[axis] - 1);
        if (!(spacing[a] >= kLeastSpacing && spacing[a] <= kMostSpacing) ||
            !(std::fabs(origin[a]) <= kMostCoordinate && std::fabs(last) <= kMostCoordinate)) {
            return fmt::format(
                "{}: spacings from {:g} to {:g} and coordinates from {:g} to {:g} are "
                "possible",
                given, kLeastSpacing, kMostSpacing, -kMostCoordinate, kMostCoordinate);
        }
        const double reach = std::max(std::fabs(origin[a]), std::fabs(last));
        if (nodes[axis] > 1 && reach <= std::numeric_limits<float>::max() &&
            static_cast<float>(last) == static_cast<float>(origin[a])) {
            const auto at = static_cast<float>(reach);
            return fmt::format(
                "{}: all {} coordinates of {} are the same to a mesh's 32-bit floats, "
                "which are {:.3g} apart there; a larger spacing or an origin nearer "
                "to 0 is possible",
                given, nodes[axis], "xyz"[axis], at - std::nextafter(at, 0.0F));
        }
    }
    return {};
}

double diagonal_of(const StoreHeader& header) {
    const Double3 last = last_position(header);
    return hypot3(last[0] - header.origin[0], last[1] - header.origin[1],
                  last[2] - header.origin[2]);
}

}  // namespace isonest::detail
