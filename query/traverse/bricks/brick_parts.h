// The mesh that the cubes of one brick make, in parts of bounded size.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

#include "query/traverse/bricks/cube_order.h"
#include "query/traverse/bricks/surface_cubes.h"
#include "query/traverse/traversal_run.h"

namespace isonest::detail {

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
    /// Calls refine(cube of level + 1, its mask) for each mask that is not 0 of a cube that meets
    /// the query's share, and hands parts on as they grow large and where a new block of vertices
    /// begins. The masks: in Morton order from cube `begin` of the brick on.
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
    /// The same for the coarsest cube itself.
    template <class Refine>
    void for_root(const Refine& refine) {
        place({0, 0, 0});
        order_ = cube_order(level_, std::uint64_t{0});
        refine();
        flush();
    }

  private:
    /// `low`: where the next block of parents begins, in nodes of level_.
    void place(const Int3& low) {
        const std::int64_t size = table_cells(run_.layout());
        const Int3 cells = run_.layout().lattice().cells_at(level_);
        // Parents reach one cell beyond an odd number of cells.
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
    AttributeSampler* attributes_ = nullptr;  ///< whose chunks near the brick are held till its end
    std::uint64_t order_ = 0;
};

}  // namespace isonest::detail
