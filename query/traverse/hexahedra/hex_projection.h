// The projection P U on an adaptive hexahedral grid: what its cells have in their corners.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 1: hexahedral cells, refined where an indicator
// says so. Cells of different size meet in hanging nodes, where what interpolation on the larger
// one's face or edge gives holds; so the function is continuous.
#pragma once

#include <cstdint>

#include <isonest/field.h>
#include <isonest/int3.h>

#include "query/view/node_sampler.h"

namespace isonest::detail {

/// A cell of level L is refined if its number is not below the threshold; the field's saturation
/// (preprocess/METHOD.md) makes the levels of cells that touch differ by one at most. In a
/// plane cells are quadrilaterals. Not thread-safe; one per thread.
class HexProjection {
  public:
    /// REQUIRES: is_of_cells(stop); the store has it.
    HexProjection(ChunkCache& cache, Field stop, double threshold)
        : numbers_(cache),
          lattice_(cache.source().layout().lattice()),
          stop_(stop),
          threshold_(threshold) {}

    /// The number of a cell of a level above 0.
    [[nodiscard]] double number(int level, const Int3& cell) {
        return numbers_.indicator(lattice_.centre_of(level, cell), stop_);
    }
    [[nodiscard]] bool stops(double number) const { return number < threshold_; }
    /// Whether there is such a cell, or would be if its parents were refined, and it is refined.
    [[nodiscard]] bool is_refined(int level, const Int3& cell);
    /// U at a node of the finest lattice that is a corner of a cell of `level`.
    [[nodiscard]] double exact(const Int3& node, int level) { return numbers_.value(node, level); }
    /// P U in a corner of a cell that is not refined, but whose parent is.
    [[nodiscard]] double value(const Int3& node);
    /// The largest number of the cells from which value() has interpolated so far, or since they
    /// were forgotten: with that of a cell itself it bounds the error in it, if the field is a
    /// bound.
    [[nodiscard]] double largest_number() const { return largest_number_; }
    void forget_largest_number() { largest_number_ = 0; }
    /// Of a volume: bits of the node positions (x + 3 y + 9 z, half edges) that HexCell::nodes has
    /// for a cell that is not refined.
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
