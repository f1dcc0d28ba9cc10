// The projection P U on an adaptive hexahedral grid: the values at the corners of its cells.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 1: hexahedral cells, refined according to an
// indicator. Cells of different size meet in hanging nodes. Their values are interpolated on the
// larger cell's face or edge, so the function is continuous.
#pragma once

#include <cstdint>

#include <isonest/field.h>
#include <isonest/int3.h>

#include "query/values/node_sampler.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// Whether a node lies in or on a cell that is not refined, without being a corner of it.
/// `stops(level, cell)`: whether an existing cell is below the threshold; the cells in it then are,
/// too. REQUIRES: node.scale > 0.
template <class Stops>
bool hangs(const Lattice& lattice, const Int3& p, const NodeInfo& node, const Stops& stops) {
    const int level = node.level();  // of the cells of which it is not a corner
    const std::int64_t edge = node.scale * 2;
    const Int3 cells = lattice.elements_at(level);
    // NOLINTNEXTLINE(clang-analyzer-core.DivideZero): the scale is more than 0
    const Int3 high{p.x / edge, p.y / edge, p.z / edge};
    for (unsigned i = 0; i < 8; ++i) {
        Int3 cell = high;
        bool twice = false;
        for (int axis = 0; axis < 3; ++axis) {
            const bool lower = (i >> static_cast<unsigned>(axis) & 1U) != 0;
            twice = twice || (lower && node.odd[static_cast<std::size_t>(axis)]);
            cell[axis] -= lower ? 1 : 0;
        }
        const bool exists = !twice && min(cell, {0, 0, 0}) == Int3{0, 0, 0} &&
                            max(cell + Int3{1, 1, 1}, cells) == cells;
        if (exists && stops(level, cell)) {
            return true;
        }
    }
    return false;
}

/// The mean of `value` at the ends of the edge, or the corners of the face or cell, whose centre
/// the node is. REQUIRES: node.scale > 0.
template <class Value>
double mean_of_corners(const Int3& p, const NodeInfo& node, const Value& value) {
    double sum = 0;
    double count = 0;
    for (unsigned i = 0; i < 8; ++i) {
        Int3 end = p;
        bool twice = false;
        for (int axis = 0; axis < 3; ++axis) {
            const bool upper = (i >> static_cast<unsigned>(axis) & 1U) != 0;
            const bool odd = node.odd[static_cast<std::size_t>(axis)];
            twice = twice || (upper && !odd);
            end[axis] += !odd ? 0 : upper ? node.scale : -node.scale;
        }
        if (!twice) {
            sum += value(end);
            ++count;
        }
    }
    return sum / count;
}

/// A cell of level L is refined if its number is not below the threshold. The field's saturation
/// (preprocess/METHOD.md) ensures that the levels of touching cells differ by at most one. In a
/// plane, cells are quadrilaterals. The class is also the NodeNumbers of AdaptTraverse on cells.
/// Not thread-safe; one per thread.
class HexProjection {
  public:
    /// REQUIRES: is_of_cells(stop); the store has it.
    HexProjection(ChunkCache& cache, Field stop, double threshold)
        : numbers_(cache),
          lattice_(cache.source().layout().lattice()),
          stop_(stop),
          threshold_(threshold) {}

    /// The number of a cell. REQUIRES: a level above 0.
    [[nodiscard]] double number(int level, const Int3& cell) {
        return numbers_.indicator(lattice_.centre_of(level, cell), stop_);
    }
    [[nodiscard]] bool stops(double number) const { return number < threshold_; }
    /// Whether the cell exists (or would exist if its parents were refined) and is refined.
    [[nodiscard]] bool is_refined(int level, const Int3& cell);
    /// See NodeNumbers.
    [[nodiscard]] double value(const Int3& p, int level) { return numbers_.value(p, level); }
    [[nodiscard]] double indicator(const Int3& x, Field field) {
        return numbers_.indicator(x, field);
    }
    /// P U at a corner of a cell that is not refined, but whose parent is.
    [[nodiscard]] double projected(const Int3& node);
    /// The largest number of the cells from which projected() has interpolated since the last
    /// forget_largest_number(). The larger of this and a cell's own number bounds the error in the
    /// cell, if the field is a bound.
    [[nodiscard]] double largest_number() const { return largest_number_; }
    void forget_largest_number() { largest_number_ = 0; }
    /// For a volume: the node positions (bits; x + 3 y + 9 z, half edges) in HexCell::nodes of a
    /// cell that is not refined.
    [[nodiscard]] std::uint32_t nodes_of(int level, const Int3& cell);

    [[nodiscard]] const Lattice& lattice() const { return lattice_; }

  private:
    NodeSampler numbers_;
    const Lattice& lattice_;
    Field stop_;
    double threshold_;
    double largest_number_ = 0;
};

}  // namespace isonest::detail
