// The plane of a slice.
#pragma once

#include <cstddef>

#include <isonest/int3.h>
#include <isonest/world.h>

#include "query/view/finest_indicators.h"
#include "query/view/topology.h"
#include "store/container/format.h"

namespace isonest::detail {

/// The plane {normal . p = offset} in coordinates of the finest lattice.
struct LatticePlane {
    Double3 normal{0, 0, 1};
    double offset = 0;

    [[nodiscard]] double distance(const Int3& p) const {
        return normal[0] * static_cast<double>(p.x) + normal[1] * static_cast<double>(p.y) +
               normal[2] * static_cast<double>(p.z) - offset;
    }
    /// At the 27 nodes of the cube whose low corner is `low`, of a lattice of this stride.
    [[nodiscard]] CubeValues distances(const Int3& low, unsigned mirror,
                                       std::int64_t stride) const {
        CubeValues out{};
        for (int p = 0; p < 27; ++p) {
            out[static_cast<std::size_t>(p)] = distance((low + node_offset(p, mirror)) * stride);
        }
        return out;
    }
};

/// In lattice coordinates, its normal so that something lies strictly below the plane where the
/// plane touches the volume: a slice along the volume's border then is not empty. Throws
/// Error{invalid_argument} if the normal is 0 or a number is not finite.
LatticePlane lattice_plane(const StoreHeader& header, const WorldPlane& world);

}  // namespace isonest::detail
