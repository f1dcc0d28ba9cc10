#include "query/traverse/bricks/finest_brick.h"

#include <array>
#include <bit>
#include <optional>

#include "query/march/clip.h"
#include "query/traverse/bricks/brick_parts.h"
#include "query/traverse/bricks/cube_nodes.h"
#include "query/traverse/bricks/leaf_march.h"

namespace isonest::detail {
namespace {

/// Of what reaches across the box, or not: what is beyond a closed one's face counts.
Sides sides_at(const Sides& sides, bool cut, const std::optional<Outside>& close) {
    return cut && close ? sides.with(*close) : sides;
}

/// The tetrahedra of one subcube, each by itself.
class ByTetrahedra {
  public:
    ByTetrahedra(TraversalRun& run, LocalMesh& mesh)
        : culling_(run.query.culling ? &*run.query.culling : nullptr),
          close_(run.query.box.close),
          counts_(run.counts.local()),
          action_(run, mesh, 0, run.query.iso) {}

    static void prepare(CubeNodes& /*nodes*/) {}
    void subcube(const CubeNodes& nodes, unsigned corner, std::uint8_t mask, bool cut) {
        const auto& tetrahedra = topology().subcube[corner];
        if (!sides_at(nodes.sides, cut, close_).both_in(nodes_of(tetrahedra, mask))) {
            return;
        }
        for (unsigned order = 0; order < 6; ++order) {
            if ((mask >> order & 1U) != 0) {
                ++counts_.visited;
                march(nodes, tetrahedra[order], cut);
            }
        }
    }
    /// If the surface passes through it and is wanted.
    void march(const CubeNodes& nodes, const TopologyTetrahedron& t, bool cut) {
        if (!sides_at(nodes.sides, cut, close_).both_in(t)) {
            return;
        }
        const auto corners = complete_corners(nodes, nodes.value, t);
        if (corners && !faces_away(nodes, t)) {
            action_(*corners, t.positive != is_mirror_image(nodes.mirror), 0, cut);
        }
    }

  private:
    [[nodiscard]] bool faces_away(const CubeNodes& nodes, const TopologyTetrahedron& t) const {
        return culling_ != nullptr && culling_->faces_away(nodes.value, t, nodes.mirror, 1, 0);
    }

    const Culling* culling_;
    std::optional<Outside> close_;
    TraversalCounts& counts_;
    LeafMarch action_;
};

/// All tetrahedra of a subcube at once. REQUIRES: neither culling nor on_leaf.
class ByCubes {
  public:
    ByCubes(TraversalRun& run, LocalMesh& mesh)
        : iso_(run.query.iso),
          is_closed_(run.query.box.close.has_value()),
          mesh_(mesh),
          counts_(run.counts.local()),
          single_(run, mesh) {}

    void prepare(CubeNodes& nodes) const { nodes.special = special_nodes(nodes.value, iso_); }
    void subcube(const CubeNodes& nodes, unsigned corner, std::uint8_t mask, bool cut) {
        if (cut && is_closed_) {
            return single_.subcube(nodes, corner, mask, cut);
        }
        counts_.visited += static_cast<std::uint64_t>(std::popcount(mask));
        Cube cube{nodes.subcube(corner), nodes.mirror ^ corner, 0, {}};
        for (unsigned i = 0; i < 8; ++i) {
            // Seen from the subcube's all-even corner, which is the parent's.
            const unsigned at = interest::kCorners[corner][i ^ corner];
            cube.value[i] = nodes.value[at];
            cube.below |= ((nodes.sides.below >> at) & 1U) << i;
        }
        if ((nodes.special & topology_.corners[corner]) == 0) {
            counts_.leaves += mesh_.march_cube(cube, iso_, cut);
            return;
        }
        for (std::size_t order = 0; order < 6; ++order) {
            const TopologyTetrahedron& t = topology_.subcube[corner][order];
            if ((nodes.special & t.nodes) == 0) {
                counts_.leaves += mesh_.march_in_cube(cube, order, iso_, cut);
            } else if ((mask >> order & 1U) != 0) {
                single_.march(nodes, t, cut);
            }
        }
    }

  private:
    double iso_;
    bool is_closed_;
    const Topology& topology_ = topology();
    LocalMesh& mesh_;
    TraversalCounts& counts_;
    ByTetrahedra single_;
};

template <class March>
class FinestBrick {
  public:
    FinestBrick(TraversalRun& run, const Int3& brick)
        : query_(run.query),
          base_(brick * run.layout().header().chunk),
          values_(run.cache, 0, base_),
          parts_(run, 0, base_),
          march_(run, parts_.mesh()) {}

    void march(const MaskList& cubes) {
        parts_.for_each_parent(cubes, 0, [&](const Int3& parent, std::uint8_t mask) {
            const Overlap overlap =
                overlap_of(query_.box, parent * 2, (parent + Int3{1, 1, 1}) * 2);
            if (overlap != Overlap::outside) {
                refine(parent, mask, overlap == Overlap::crossing);
            }
        });
    }

  private:
    /// All that a cube of level 1 has below it, without the tetrahedra on the way.
    void refine(const Int3& parent, std::uint8_t mask, bool cut) {
        CubeNodes nodes;
        values_.load(nodes, parent);
        nodes.cut = cut;
        nodes.sides = sides_of(nodes.value, query_.iso);
        const Sides sides = sides_at(nodes.sides, cut, query_.box.close);
        if (!sides.both_in(nodes_of(topology_.cube, mask))) {
            return;
        }
        march_.prepare(nodes);
        std::array<std::uint8_t, 8> below{};
        for (unsigned order = 0; order < 6; ++order) {
            if ((mask >> order & 1U) != 0 && sides.both_in(topology_.cube[order])) {
                for (unsigned corner = 0; corner < 8; ++corner) {
                    below[corner] |= topology_.below_cube[order][corner];
                }
            }
        }
        for (unsigned corner = 0; corner < 8; ++corner) {
            if (below[corner] != 0 && sides.both_in(topology_.corners[corner])) {
                subcube(nodes, corner, below[corner]);
            }
        }
    }
    void subcube(const CubeNodes& nodes, unsigned corner, std::uint8_t mask) {
        bool cut = nodes.cut;
        if (cut) {
            const Int3 cube = nodes.subcube(corner);
            const Overlap overlap = overlap_of(query_.box, cube, cube + Int3{1, 1, 1});
            if (overlap == Overlap::outside) {
                return;
            }
            cut = overlap == Overlap::crossing;
        }
        march_.subcube(nodes, corner, mask, cut);
    }

    const TraversalQuery& query_;
    Int3 base_;
    const Topology& topology_ = topology();
    CubeLoader values_;
    BrickParts parts_;
    March march_;
};

}  // namespace

void march_finest_brick(TraversalRun& run, const Int3& brick, const MaskList& cubes) {
    if (run.query.culling || run.query.on_leaf) {
        FinestBrick<ByTetrahedra>(run, brick).march(cubes);
    } else {
        FinestBrick<ByCubes>(run, brick).march(cubes);
    }
}

}  // namespace isonest::detail
