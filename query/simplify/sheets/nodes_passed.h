// Whether a surface would pass over a node of the lattice if a vertex is collapsed.
#pragma once

#include <array>

#include <isonest/int3.h>

#include "query/simplify/block_grid.h"
#include "query/simplify/collapse/star_collapse.h"

namespace isonest::detail {

/// Nodes that a surface must not pass over.
struct KeptNodes {
    /// So that programs which round find a node on its side, too.
    static constexpr double kLeastMargin = 1e-3;

    WorldLattice lattice;
    /// How near a surface may come, in distances between nodes, beside what rounding moves it.
    double margin = kLeastMargin;
};

/// What lies between the triangles around a vertex and those that take their place is put together
/// of the tetrahedra that the old triangles span with the corner which the vertex becomes: their
/// borders add up to the new triangles less the old ones. So the winding number around a node in
/// none of them stays what it is. Nodes nearer to a tetrahedron than the margin count as in it.
/// Thread-safety: constant data.
class NodesPassed {
  public:
    explicit NodesPassed(const KeptNodes& nodes) : lattice_(nodes.lattice), margin_(nodes.margin) {}

    /// Whether a node may be passed by the collapse of `star`, whose middle lies at `middle`, world
    /// coordinates, and was `slid` there by that vector before.
    [[nodiscard]] bool any(const Star& star, const Double3& middle, const Double3& slid) const;

  private:
    using Tetrahedron = std::array<Double3, 4>;
    [[nodiscard]] Double3 in_lattice(const Double3& world) const;
    [[nodiscard]] bool has_node(const Tetrahedron& t) const;

    WorldLattice lattice_;
    double margin_;
};

}  // namespace isonest::detail
