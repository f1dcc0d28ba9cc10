// What a walk over cells reads of a store behind a network, for look_ahead().
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "query/traverse/far/look_ahead.h"
#include "query/traverse/hexahedra/cell_interest.h"
#include "query/traverse/hexahedra/cell_walk.h"
#include "query/traverse/subtree_walk.h"

namespace isonest::detail {

/// A scout of subtrees that are cells: of a volume those with the surface or the plane, in a plane
/// all. Not thread-safe.
template <int D>
class CellScout {
  public:
    CellScout(ChunkCache& cache, const TraversalQuery& query, const CubeShare& share)
        : walk_(cache.source().layout().lattice(), query.box, share),
          query_(query),
          layout_(cache.source().layout()),
          is_finest_(query.tolerance.is_zero()),
          projection_(cache, query.stop, query.tolerance.threshold()) {}

    void operator()(const Cell& subtree, const LookWalk& how, Wants& wants) {
        how_ = how;
        wants_ = &wants;
        walk_.subtree(subtree, *this);
    }
    /// See CellWalk.
    bool refines(const Cell& cell, Overlap /*where*/) {
        if (cell.level == how_.level) {
            if (!how_.at_leaves) {
                want_cell(cell);
            }
            return false;
        }
        const double number =
            cell.level > 0 && !is_finest_ ? projection_.number(cell.level, cell.at) : 0;
        if (D == 3 && !is_of_interest(query_, projection_, cell, number)) {
            return false;
        }
        if (cell.level > 0 && (is_finest_ || !projection_.stops(number))) {
            return true;
        }
        if (how_.at_leaves) {
            want_leaf(cell);
        }
        return false;
    }

  private:
    static constexpr Int3 kOne{1, 1, D == 3 ? 1 : 0};

    static Int3 above(const Int3& at, int levels) {
        return {at.x >> levels, at.y >> levels, at.z >> levels};
    }
    /// What the tests ask for.
    void want_cell(const Cell& cell) {
        if (cell.level > 0 && !is_finest_) {
            const ArrayInfo& numbers = layout_.array(cell.level, query_.stop);
            wants_->box(numbers, cell.at, cell.at);
        }
        if (D == 3 && !query_.plane) {
            wants_->box(layout_.array(cell.level, Field::values), cell.at, cell.at + kOne);
        }
    }
    /// What the projection in its nodes takes, and the attributes of the vertices on its edges.
    void want_leaf(const Cell& cell) {
        wants_->box(layout_.array(cell.level, Field::values), cell.at, cell.at + kOne);
        bool has_numbers = cell.level > 0 && !is_finest_;
        for (int level = cell.level; level <= layout_.lattice().top() && !is_finest_; ++level) {
            const Int3 at = above(cell.at, level - cell.level);
            wants_->box(layout_.array(level, Field::values), at, at + kOne);
            if (level > 0) {
                has_numbers =
                    wants_->box(layout_.array(level, query_.stop), at - kOne, at + kOne) &&
                    has_numbers;
            }
        }
        want_attributes(cell.level, cell.at, cell.at + kOne);
        if (has_numbers && is_beside_finer(cell)) {
            const Int3 at = cell.at * 2;
            wants_->box(layout_.array(cell.level - 1, Field::values), at, at + kOne * 2);
            want_attributes(cell.level - 1, at, at + kOne * 2);
        }
    }
    /// REQUIRES: the numbers around the cell were announced.
    [[nodiscard]] bool is_beside_finer(const Cell& cell) {
        const Int3 around = kOne * 2 + Int3{1, 1, 1};
        for (std::int64_t i = 0; i < around.product(); ++i) {
            const Int3 beside = cell.at + around.unlinear(i) - kOne;
            if (!(beside == cell.at) && projection_.is_refined(cell.level, beside)) {
                return true;
            }
        }
        return false;
    }
    /// Of vertices on edges of a level between these of its nodes.
    void want_attributes(int level, const Int3& low, const Int3& high) {
        const AttributeChoice& choice = query_.attributes;
        if (choice.needs_gradient() && D == 3) {
            wants_->box(layout_.array(level, Field::values), low - kOne, high + kOne);
        } else if (choice.needs_gradient()) {
            // Vertices are nodes, which have the finest gradient.
            const std::int64_t edge = std::int64_t{1} << level;
            for (const Int3& p :
                 {low, high, Int3{low.x, high.y, low.z}, Int3{high.x, low.y, low.z}}) {
                wants_->box(layout_.array(0, Field::values), p * edge - kOne, p * edge + kOne);
            }
        }
        if (choice.error && level > 0) {
            const ArrayInfo& array = layout_.array(level, *choice.error);
            wants_->box(array, low, high);
            if (array.first_slot > 0) {
                wants_->box(layout_.array(0, Field::values), low * 2, high * 2 + Int3{2, 2, 2});
            }
        }
        if (choice.value && query_.attribute_values != nullptr) {
            const ArrayInfo& other =
                query_.attribute_values->source().layout().array(level, Field::values);
            const Int3 from = other.chunk_of(low);
            const Int3 size =
                other.chunk_of(min(high, other.nodes - Int3{1, 1, 1})) - from + Int3{1, 1, 1};
            for (std::int64_t i = 0; i < size.product(); ++i) {
                wants_->other_chunk(other, from + size.unlinear(i));
            }
        }
    }

    CellWalk<D> walk_;
    const TraversalQuery& query_;
    const StoreLayout& layout_;
    bool is_finest_;
    HexProjection projection_;
    LookWalk how_{};
    Wants* wants_ = nullptr;
};

/// The leaves of all cells, by workers that make() makes, each with a CellWalk<D> `walk`. The
/// subtrees that are the threads' work begin `top_levels` below the coarsest level.
template <int D, class Make>
TraversalCounts walk_cells(ChunkCache& cache, const TraversalQuery& query, int top_levels,
                           Progress& progress, const Make& make) {
    const Lattice& lattice = cache.source().layout().lattice();
    const int level_left = std::max(lattice.top() - top_levels, 0);
    const auto look = [&](std::span<const Cell> cells, int coarsest, int finest,
                          const CubeShare& share) {
        return look_ahead(cache, query.attribute_values, cells, coarsest, finest, true,
                          [&] { return CellScout<D>(cache, query, share); });
    };
    return walk_subtrees<Cell>(
        cache.source().is_far(), make,
        [&](auto& worker, std::vector<Cell>& left) {
            if (cache.source().is_far()) {
                const Int3 roots = lattice.elements_at(lattice.top());
                std::vector<Cell> coarsest;
                for (std::int64_t i = 0; i < roots.product(); ++i) {
                    coarsest.push_back({lattice.top(), roots.unlinear(i)});
                }
                look(coarsest, lattice.top(), level_left + 1, {});
            }
            worker.walk.above(level_left, worker, left);
            progress.begin("extract", left.size(), "");
        },
        [&](auto& worker, const Cell& cell) {
            worker.walk.subtree(cell, worker);
            progress.advance(1);
        },
        [&](std::span<const Cell> cells) { return look(cells, level_left, 0, query.share); });
}

}  // namespace isonest::detail
