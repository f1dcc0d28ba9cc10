// SimplexAction of volumes: a leaf tetrahedron is counted, told about and marched.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>

#include "query/traverse/bricks/cube_nodes.h"
#include "query/traverse/traversal_run.h"

namespace isonest::detail {

/// The corners of a tetrahedron of a cube's tables, with the values of the function that is
/// marched; nothing if a value is missing.
inline std::optional<std::array<Corner, 4>> complete_corners(const CubeNodes& nodes,
                                                             const CubeValues& function,
                                                             const TopologyTetrahedron& t) {
    std::array<Corner, 4> corners;
    for (std::size_t i = 0; i < 4; ++i) {
        const int position = t.vertices[i];
        const auto at = static_cast<std::size_t>(position);
        if (!std::isfinite(nodes.value[at]) || !std::isfinite(function[at])) {
            return std::nullopt;
        }
        corners[i] = {nodes.low + node_offset(position, nodes.mirror), function[at]};
    }
    return corners;
}

class LeafMarch {
  public:
    /// `iso`: of the function that is marched.
    LeafMarch(TraversalRun& run, LocalMesh& mesh, int level, double iso)
        : on_leaf_(run.query.on_leaf),
          mesh_(mesh),
          counts_(run.counts.local()),
          level_(level),
          iso_(iso) {}

    /// `positive`: the corners' orientation, as LocalMesh::march() asks; `cut`: the leaf may reach
    /// out of the box.
    void operator()(const std::array<Corner, 4>& corners, bool positive, double eta, bool cut) {
        ++counts_.leaves;
        counts_.error_bound = std::max(counts_.error_bound, eta);
        if (on_leaf_) {
            Leaf leaf{level_, corners};
            for (Corner& corner : leaf.corners) {
                corner.node = corner.node * (std::int64_t{1} << level_);
            }
            on_leaf_(leaf);
        }
        mesh_.march(corners, positive, iso_, cut);
    }

  private:
    const std::function<void(const Leaf&)>& on_leaf_;
    LocalMesh& mesh_;
    TraversalCounts& counts_;
    int level_;
    double iso_;
};

}  // namespace isonest::detail
