// AdaptTraverse within one brick: from cubes of the level above to leaves and subcubes.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 2 and 5. This is the fast path for volumes. It
// finds the same leaves as query/traverse/adapt_traverse.h, but a cube at a time. The unit is a
// cube with a mask of its active Kuhn tetrahedra; a brick is the cubes of one level in one chunk of
// values. Saturation makes most tests unnecessary: where the nodes of both edges of a face refine,
// the face's node refines too. The next test is then that of the subcubes, two bisections further
// down.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "query/march/clip.h"
#include "query/traverse/bricks/brick_parts.h"
#include "query/traverse/bricks/brick_tests.h"

namespace isonest::detail {

/// The work on one brick. Input: cubes of level + 1 whose tetrahedra are to be refined. Output:
/// marched leaves, and cubes of the level whose tetrahedra are to be refined. Interest:
/// IsovalueByBound or PlaneByDistance. Members that decide are const; members that act decide
/// nothing. One per thread and brick.
template <class Interest>
class BrickTraversal {
  public:
    BrickTraversal(TraversalRun& run, int level, const Int3& brick);

    /// Refines all cubes of the brick that `parents` activates: masks in Morton order, starting at
    /// cube `begin`.
    void refine_parents(const MaskList& parents, std::size_t begin);
    /// Refines the coarsest cube.
    void root();

    /// The work for child brick `octant`; null if there is none.
    [[nodiscard]] std::unique_ptr<MaskList> take_children(std::size_t octant) {
        return std::move(children_[octant]);
    }

  private:
    /// The result of the interest test for a tetrahedron, with the test's number if it was needed.
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
    /// For a cube or subcube. `cut`: it extends across the box. At a closed box the outside is
    /// included.
    [[nodiscard]] Sides sides_of(const CubeNodes& nodes, bool cut) const {
        return cut && query_.box.close ? nodes.sides.with(*query_.box.close) : nodes.sides;
    }
    [[nodiscard]] std::uint8_t refined_to_subcubes(CubeNodes& nodes, std::uint8_t mask) const;

    // Actions.
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
    bool is_for_others_ = false;              ///< the cube's leaves belong to another rank
    std::array<std::uint8_t, 8> subcubes_{};  ///< masks of the parent's subcubes, in table order
    std::array<std::unique_ptr<MaskList>, 8> children_;
};

}  // namespace isonest::detail
