#include "query/traverse/lattice_plane.h"

#include <algorithm>
#include <cmath>

#include <isonest/error.h>

namespace isonest::detail {

LatticePlane lattice_plane(const StoreHeader& header, const WorldPlane& world) {
    LatticePlane plane;
    plane.offset = world.offset;
    double size = 0;
    double low = 0;  // of n . p over the volume
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        plane.normal[a] = world.normal[a] * header.spacing[a];
        plane.offset -= world.normal[a] * header.origin[a];
        size += std::fabs(world.normal[a]);
        low += std::min(0.0, plane.normal[a] * static_cast<double>(header.nodes[axis] - 1));
    }
    if (!(size > 0) || !std::isfinite(size) || !std::isfinite(world.offset)) {
        throw Error(ErrorKind::invalid_argument,
                    "plane: the normal must be finite and not zero, the offset finite");
    }
    if (low >= plane.offset) {
        for (double& n : plane.normal) {
            n = -n;
        }
        plane.offset = -plane.offset;
    }
    return plane;
}

}  // namespace isonest::detail
