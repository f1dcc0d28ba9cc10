// The data that a traversal of cells reads from a remote store (ElementScout).
#pragma once

#include <algorithm>
#include <cstdint>

#include "query/traverse/adapt_traverse.h"
#include "query/traverse/hexahedra/hex_projection.h"
#include "query/traverse/remote/look_ahead.h"

namespace isonest::detail {

class CellNeeds {
  public:
    /// `reads_corners`: whether the interest test reads U at the corners.
    CellNeeds(const TraversalRun& run, bool reads_corners)
        : query_(run.query),
          layout_(run.layout()),
          is_finest_(run.query.tolerance.is_zero()),
          reads_corners_(reads_corners) {}

    /// Adds the data needed by the tests.
    void element(const Cell& cell, Wants& wants) const {
        if (cell.level > 0 && !is_finest_) {
            wants.box(layout_.array(cell.level, query_.stop), cell.at, cell.at);
        }
        if (reads_corners_) {
            wants.box(layout_.array(cell.level, Field::values), cell.at, cell.at + cell.extent);
        }
    }
    /// Adds the data needed by the projection at its nodes, and by the attributes of the vertices
    /// on its edges.
    void leaf(const Cell& cell, HexProjection& projection, Wants& wants) const {
        const Int3& extent = cell.extent;
        wants.box(layout_.array(cell.level, Field::values), cell.at, cell.at + extent);
        bool has_numbers = cell.level > 0 && !is_finest_;
        for (int level = cell.level; level <= layout_.lattice().top() && !is_finest_; ++level) {
            const Int3 at = above(cell.at, level - cell.level);
            wants.box(layout_.array(level, Field::values), at, at + extent);
            if (level > 0) {
                has_numbers =
                    wants.box(layout_.array(level, query_.stop), at - extent, at + extent) &&
                    has_numbers;
            }
        }
        want_attributes(cell.level, cell.at, cell.at + extent, extent, wants);
        if (has_numbers && is_beside_finer(cell, projection)) {
            const Int3 at = cell.at * 2;
            wants.box(layout_.array(cell.level - 1, Field::values), at, at + extent * 2);
            want_attributes(cell.level - 1, at, at + extent * 2, extent, wants);
        }
    }

  private:
    static Int3 above(const Int3& at, int levels) {
        return {at.x >> levels, at.y >> levels, at.z >> levels};
    }
    /// REQUIRES: the numbers around the cell were prefetched.
    [[nodiscard]] static bool is_beside_finer(const Cell& cell, HexProjection& projection) {
        const Int3& extent = cell.extent;
        const Int3 around = extent * 2 + Int3{1, 1, 1};
        for (std::int64_t i = 0; i < around.product(); ++i) {
            const Int3 beside = cell.at + around.unlinear(i) - extent;
            if (!(beside == cell.at) && projection.is_refined(cell.level, beside)) {
                return true;
            }
        }
        return false;
    }
    /// For vertices on edges of a level between these nodes.
    void want_attributes(int level, const Int3& low, const Int3& high, const Int3& extent,
                         Wants& wants) const {
        const AttributeChoice& choice = query_.attributes;
        if (choice.needs_gradient() && extent.z > 0) {
            wants.box(layout_.array(level, Field::values), low - extent, high + extent);
        } else if (choice.needs_gradient()) {
            // Vertices are nodes, which use the finest gradient.
            const std::int64_t edge = std::int64_t{1} << level;
            for (const Int3& p :
                 {low, high, Int3{low.x, high.y, low.z}, Int3{high.x, low.y, low.z}}) {
                wants.box(layout_.array(0, Field::values), p * edge - extent, p * edge + extent);
            }
        }
        if (choice.error && level > 0) {
            const ArrayInfo& array = layout_.array(level, *choice.error);
            wants.box(array, low, high);
            if (array.first_slot > 0) {
                wants.box(layout_.array(0, Field::values), low * 2, high * 2 + Int3{2, 2, 2});
            }
        }
        if (choice.value && query_.attribute_values != nullptr) {
            const ArrayInfo& other =
                query_.attribute_values->source().layout().array(level, Field::values);
            const Int3 from = other.chunk_of(low);
            const Int3 size =
                other.chunk_of(min(high, other.nodes - Int3{1, 1, 1})) - from + Int3{1, 1, 1};
            for (std::int64_t i = 0; i < size.product(); ++i) {
                wants.other_chunk(other, from + size.unlinear(i));
            }
        }
    }

    const TraversalQuery& query_;
    const StoreLayout& layout_;
    bool is_finest_;
    bool reads_corners_;
};

}  // namespace isonest::detail
