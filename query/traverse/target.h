// What a traversal looks for: the isosurface of the data, or a plane through it.
#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>

#include <isonest/int3.h>

#include "query/traverse/topology.h"
#include "query/view/finest_indicators.h"

namespace isonest::detail {

/// The plane {normal . p = offset} in coordinates of the finest lattice.
struct LatticePlane {
    Double3 normal{0, 0, 1};
    double offset = 0;

    [[nodiscard]] double distance(const Int3& p) const {
        return normal[0] * static_cast<double>(p.x) + normal[1] * static_cast<double>(p.y) +
               normal[2] * static_cast<double>(p.z) - offset;
    }
};

/// A function on the nodes whose level set is marched. A plane's function is linear, so that every
/// element shows it exactly, and nothing but the stop test refines.
class Target {
  public:
    Target(double iso, const std::optional<LatticePlane>& plane) : iso_(iso), plane_(plane) {}

    [[nodiscard]] double level() const { return plane_ ? 0 : iso_; }
    /// A plane's function is exact on every element: no bound is needed.
    [[nodiscard]] bool is_plane() const { return plane_.has_value(); }
    /// From the plane, at the 27 nodes of the cube whose low corner is `low`. REQUIRES: is_plane().
    [[nodiscard]] CubeValues distances(const Int3& low, unsigned mirror,
                                       std::int64_t stride) const {
        CubeValues out{};
        for (int p = 0; p < 27; ++p) {
            out[static_cast<std::size_t>(p)] =
                plane_->distance((low + node_offset(p, mirror)) * stride);
        }
        return out;
    }

  private:
    double iso_;
    std::optional<LatticePlane> plane_;
};

}  // namespace isonest::detail
