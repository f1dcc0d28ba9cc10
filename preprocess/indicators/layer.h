// One layer of refinement nodes: the nodes that one z-plane of level-L lattice nodes owns.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "store/base/box.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// The part of level L that a kernel works on: lattice nodes lo..hi inclusive, where hi lies one
/// past the nodes to be produced unless the volume ends there.
struct LayerRange {
    Int3 lo;
    Int3 hi;
    Int3 cells;  ///< cubes of the level per axis

    [[nodiscard]] std::int64_t count(int axis) const { return hi[axis] - lo[axis] + 1; }
    /// Lattice nodes whose nodes at an odd offset along `axis` can be computed here.
    [[nodiscard]] std::int64_t odd_count(int axis) const {
        return std::min(hi[axis], cells[axis]) - lo[axis];
    }
    [[nodiscard]] std::int64_t count(int axis, int offset) const {
        return offset == 0 ? count(axis) : odd_count(axis);
    }
};

/// Calls f(slot, i, j) for every node of slots first to last of a layer that can be computed here;
/// its owner is the lattice node lo + (i, j).
template <class F>
void each_node(const LayerRange& range, int first, int last, const F& f) {
    for (int slot = first; slot <= last; ++slot) {
        const Int3 o = slot_offset(slot);
        for (std::int64_t j = 0; j < range.count(1, static_cast<int>(o.y)); ++j) {
            for (std::int64_t i = 0; i < range.count(0, static_cast<int>(o.x)); ++i) {
                f(slot, i, j);
            }
        }
    }
}

/// Seven arrays [y][x] of one layer, each row with one spare element behind it.
template <class Real>
class Layer {
  public:
    Layer() = default;
    Layer(std::int64_t nx, std::int64_t ny)
        : pitch_(nx + 1),
          data_(static_cast<std::size_t>(kSlots * pitch_ * (ny + 1))),
          rows_(ny + 1) {}
    [[nodiscard]] Real* row(int slot, std::int64_t y) {
        return data_.data() + (slot * rows_ + y) * pitch_;
    }
    [[nodiscard]] const Real* row(int slot, std::int64_t y) const {
        return data_.data() + (slot * rows_ + y) * pitch_;
    }
    void clear() { std::fill(data_.begin(), data_.end(), Real{0}); }

  private:
    std::int64_t pitch_ = 0;
    std::vector<Real> data_;
    std::int64_t rows_ = 0;
};

/// Values of one plane of the lattice of stride 2^(L-1), rows split by the parity of x:
/// even(y)[i] = U(2 (lo.x + i), y), odd(y)[i] = U(2 (lo.x + i) + 1, y), y counted from 2 lo.y.
template <class Real>
class SplitPlane {
  public:
    SplitPlane() = default;
    explicit SplitPlane(const LayerRange& range)
        : pitch_(range.count(0) + 1),
          rows_(2 * range.count(1) - 1),
          data_(static_cast<std::size_t>(2 * pitch_ * rows_)) {}
    [[nodiscard]] Real* even(std::int64_t y) { return data_.data() + 2 * y * pitch_; }
    [[nodiscard]] Real* odd(std::int64_t y) { return data_.data() + (2 * y + 1) * pitch_; }
    [[nodiscard]] const Real* even(std::int64_t y) const { return data_.data() + 2 * y * pitch_; }
    [[nodiscard]] const Real* odd(std::int64_t y) const {
        return data_.data() + (2 * y + 1) * pitch_;
    }
    [[nodiscard]] std::int64_t pitch() const { return pitch_; }
    [[nodiscard]] std::int64_t rows() const { return rows_; }

  private:
    std::int64_t pitch_ = 0;
    std::int64_t rows_ = 0;
    std::vector<Real> data_;
};

}  // namespace isonest::detail
