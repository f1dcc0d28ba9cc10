// AdaptTraverse within one brick: from cubes of the level above to leaves and to subcubes.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 2 and 5. The fast path of volumes: it finds the
// leaves that query/traverse/adapt_traverse.h finds, but a cube at a time. The unit is a cube with
// a mask of its active Kuhn tetrahedra; a brick is the cubes of one level in one chunk of values.
// Saturation saves most questions: where the nodes of both edges of a face refine, so does the
// face's, and then the subcubes are asked next, two bisections further down.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "query/march/clip.h"
#include "query/traverse/bricks/brick_interest.h"
#include "query/traverse/bricks/brick_parts.h"
#include "query/traverse/bricks/brick_stop.h"
#include "query/traverse/bricks/leaf_march.h"

namespace isonest::detail {

/// The work on one brick: cubes of level + 1 whose tetrahedra are to be refined come in, leaves are
/// marched, and cubes of the level whose tetrahedra are to be refined go out. Interest:
/// IsovalueByBound or PlaneByDistance. Of the members, those that decide are const, and those that
/// act decide nothing. One per thread and brick.
template <class Interest>
class BrickTraversal {
  public:
    BrickTraversal(TraversalRun& run, int level, const Int3& brick);

    /// All cubes of the brick that `parents` activates: masks in Morton order from cube `begin` on.
    void refine_parents(const MaskList& parents, std::size_t begin);
    /// The coarsest cube itself.
    void root();

    /// What child brick `octant` has to do; null if nothing.
    [[nodiscard]] std::unique_ptr<MaskList> take_children(std::size_t octant) {
        return std::move(children_[octant]);
    }

  private:
    /// What is known of a tetrahedron that may hold the surface: the interest test's number, if it
    /// was asked.
    struct Question {
        bool may_hold = false;
        std::optional<double> number;
    };
    // Decisions.
    [[nodiscard]] Question question(const CubeNodes& nodes, const TopologyTetrahedron& t) const;
    [[nodiscard]] std::optional<double> stopped(const CubeNodes& nodes,
                                                const TopologyTetrahedron& t,
                                                std::optional<double> number) const;
    [[nodiscard]] bool edges_refine(CubeNodes& nodes, const TopologyTetrahedron& face) const;
    /// Of a cube, or a subcube, that reaches across the box or not: what is beyond a closed one's
    /// face counts.
    [[nodiscard]] Sides sides_of(const CubeNodes& nodes, bool cut) const {
        return cut && query_.box.close ? nodes.sides.with(*query_.box.close) : nodes.sides;
    }
    [[nodiscard]] std::uint8_t refined_to_subcubes(CubeNodes& nodes, std::uint8_t mask) const;

    // What is done about them.
    void refine(const Int3& parent, std::uint8_t mask);
    template <class Work>
    void for_others(const Work& work);
    std::uint8_t visit_cube(const CubeNodes& nodes, std::uint8_t mask);
    void face(CubeNodes& nodes, std::size_t index);
    void edge(CubeNodes& nodes, std::size_t index);
    void subcube(const CubeNodes& nodes, unsigned corner, std::uint8_t mask);
    void sharpen(CubeNodes& nodes) const;
    void skip_to_subcubes(CubeNodes& nodes, const std::array<std::uint8_t, 8>& below);
    [[nodiscard]] Overlap overlap_of_leaf(const std::array<Corner, 4>& corners) const;
    void march(const CubeNodes& nodes, const TopologyTetrahedron& t, double eta, bool cut);
    void hand_down(const Int3& cube, std::uint8_t mask);

    TraversalRun& run_;
    const TraversalQuery& query_;
    BrickPlace at_;
    CubeLoader values_;
    Interest interest_;
    BrickStop stop_;
    CullingInBrick culling_;
    BrickParts parts_;
    LeafMarch action_;
    TraversalCounts& counts_;
    const Topology& topology_ = topology();
    bool is_for_others_ = false;              ///< the cube's leaves are another rank's
    std::array<std::uint8_t, 8> subcubes_{};  ///< masks of the parent's subcubes, in table order
    std::array<std::unique_ptr<MaskList>, 8> children_;
};

}  // namespace isonest::detail
