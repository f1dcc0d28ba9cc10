// The mesh of one brick's cubes, in parts of bounded size, and the action that adds leaves to it.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>

#include <isonest/int3.h>

#include "query/traverse/bricks/brick_tests.h"
#include "query/traverse/bricks/finest_brick.h"
#include "query/traverse/traversal.h"
#include "query/values/blocks.h"

namespace isonest::detail {

// Sort keys of the parts of a result; they do not depend on threads.

/// Sort key for cubes: coarser levels first, within a level by Morton code.
constexpr std::uint64_t cube_order(int level, std::uint64_t morton) {
    return static_cast<std::uint64_t>(63 - level) << 57U | morton;
}
/// For the cube of edge 2^level whose low corner is node `low` of the finest lattice.
constexpr std::uint64_t cube_order(int level, const Int3& low) {
    return cube_order(level, morton_code({low.x >> level, low.y >> level, low.z >> level}));
}

class BrickParts {
  public:
    /// `base`: the brick's first node, in nodes of its level.
    BrickParts(TraversalRun& run, int level, const Int3& base)
        : run_(run), mesh_(run.meshes.local()), level_(level), base_(base) {
        if (run.query.attributes.width() > 0) {
            attributes_ = &run.attributes.local();
            attributes_->enter(level, base * (std::int64_t{1} << level));
        }
    }
    BrickParts(const BrickParts&) = delete;
    BrickParts& operator=(const BrickParts&) = delete;
    ~BrickParts() {
        if (attributes_ != nullptr) {
            attributes_->leave();
        }
        if (run_.query.vertices == VertexPlace::exact) {
            run_.crossings.local().leave();
        }
    }

    [[nodiscard]] LocalMesh& mesh() { return mesh_; }
    /// Calls refine(cube of level + 1, its mask) for each nonzero mask of a cube that meets the
    /// query's share. Passes parts on when they become large and when a new block of vertices
    /// begins. Masks are in Morton order, starting at cube `begin` of the brick.
    template <class Refine>
    void for_each_parent(const MaskList& parents, std::size_t begin, const Refine& refine) {
        const Int3 first{base_.x / 2, base_.y / 2, base_.z / 2};
        const auto half_block = static_cast<std::size_t>(table_cells(run_.layout()) / 2);
        const std::size_t block_size = half_block * half_block * half_block;
        std::size_t block = std::numeric_limits<std::size_t>::max();
        const auto [shared, shared_end] =
            run_.query.share.meeting(level_ + 1, morton_code(first) + begin, parents.size());
        for (std::size_t i = shared; i < shared_end; ++i) {
            if (parents[i] == 0) {
                continue;
            }
            if (const std::size_t next = (begin + i) / block_size; next != block) {
                flush();
                block = next;
                place(first * 2 + morton_point(block * block_size) * 2);
            }
            const Int3 parent = first + morton_point(begin + i);
            if (mesh_.empty()) {
                order_ = cube_order(level_, morton_code(parent));
            }
            refine(parent, parents[i]);
            if (mesh_.size() >= run_.part_vertices) {
                flush();
            }
        }
        flush();
    }
    /// The same for the coarsest cube.
    template <class Refine>
    void for_root(const Refine& refine) {
        place({0, 0, 0});
        order_ = cube_order(level_, std::uint64_t{0});
        refine();
        flush();
    }

  private:
    /// `low`: start of the next block of parents, in nodes of level_.
    void place(const Int3& low) {
        const std::int64_t size = table_cells(run_.layout());
        const Int3 cells = run_.layout().lattice().cells_at(level_);
        // Parents extend one cell beyond an odd number of cells.
        const Int3 left = cells - low + Int3{1, 1, 1};
        mesh_.place(low, level_, max(min(left, {size, size, size}), {1, 1, 1}));
    }
    void flush() {
        if (!mesh_.empty()) {
            run_.sink(order_, mesh_.finish(run_.query.box));
        }
    }

    TraversalRun& run_;
    LocalMesh& mesh_;
    int level_;
    Int3 base_;
    AttributeSampler* attributes_ = nullptr;  ///< holds its chunks near the brick until the brick
                                              ///< is done
    std::uint64_t order_ = 0;
};

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

/// SimplexAction: counts, reports and marches a leaf tetrahedron.
class LeafMarch {
  public:
    /// `iso`: isovalue of the function that is marched.
    LeafMarch(TraversalRun& run, LocalMesh& mesh, int level, double iso)
        : on_leaf_(run.query.on_leaf),
          mesh_(mesh),
          counts_(run.counts.local()),
          level_(level),
          iso_(iso) {}

    /// `positive`: orientation of the corners, as for LocalMesh::march(). `cut`: the leaf may
    /// extend beyond the box.
    void operator()(const std::array<Corner, 4>& corners, bool positive, double eta, bool cut) {
        ++counts_.leaves;
        counts_.stopped_at = std::max(counts_.stopped_at, eta);
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
