// The deviation indicator: how far the finest function can be from a tetrahedron's linear function.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 3, eta*_infinity(x) = |U - U^l| over the support
// of x, which the paper calls too expensive. Here it is streamed: with the values two levels finer
// (stride 2^(L-2)) and the deviation D already known there,
//   D(T) <= max over the finer T' in T of (max over vertices v of T' of |U(v) - U_T(v)| + D(T')),
// exact at levels 1 and 2, where D(T') = 0.
#pragma once

#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "preprocess/deviation_table.h"
#include "preprocess/layer.h"

namespace isonest {

/// Computes the unsaturated deviation of the nodes of level L >= 2, one layer after another.
/// Coordinates of values and finer cubes are those of level L-2.
template <class Real>
class DeviationKernel {
  public:
    /// `fine_cells`: cubes of level L-2 per axis. `with_fine` says whether level L-2 has deviations
    /// of its own (L > 2). REQUIRES: range.lo.x is even.
    DeviationKernel(const LayerRange& range, const Int3& fine_cells, bool with_fine)
        : range_(range),
          fine_cells_(fine_cells),
          rows_(4 * (range.hi.y - range.lo.y) + 5),
          groups_((4 * (range.hi.x - range.lo.x) + 8) / 8 + 3),
          values_(static_cast<std::size_t>(kRing * rows_ * kPhases * groups_)),
          fine_(with_fine ? values_.size() : 0),
          valid_(static_cast<std::size_t>(kPhases * groups_)) {
        for (std::int64_t i = 0; i < kPhases * groups_; ++i) {
            const std::int64_t x = first_x() + i;
            valid_[split(i)] = x >= 0 && x <= fine_cells.x ? Real{0} : kNan;
        }
    }

    /// Coordinates that a plane of values or finer deviations must cover: x and y from first to
    /// last.
    [[nodiscard]] std::int64_t low_x() const { return 4 * range_.lo.x - 2; }
    [[nodiscard]] std::int64_t high_x() const { return 4 * range_.hi.x + 2; }
    [[nodiscard]] std::int64_t low_y() const { return 4 * range_.lo.y - 2; }
    [[nodiscard]] std::int64_t high_y() const { return 4 * range_.hi.y + 2; }

    /// Brings in plane z: value(y, out) writes the values at x = low_x() .. high_x() of row y
    /// (those outside the volume clamped, missing ones 0), fine(y, out) likewise D of the finer
    /// cubes, NaN where there is no cube. REQUIRES: called for z = 4k - 2 .. 4k + 4 before layer k,
    /// in order.
    template <class Value, class Fine>
    void load_plane(std::int64_t z, Value&& value, Fine&& fine) {
        line_.resize(static_cast<std::size_t>(high_x() - low_x() + 1));
        for (std::int64_t y = low_y(); y <= high_y(); ++y) {
            value(y, line_.data());
            scatter(values_, y, z);
            if (!fine_.empty()) {
                fine(y, line_.data());
                scatter(fine_, y, z);
            }
        }
    }

    /// Slots 0 to 2 (first = 0, last = 2) or 3 to 6 of layer k.
    void layer(std::int64_t k, int first_slot, int last_slot, Layer<Real>& out) {
        for (int slot = first_slot; slot <= last_slot; ++slot) {
            const Int3 o = slot_offset(slot);
            for (std::int64_t j = 0; j < range_.count(1, static_cast<int>(o.y)); ++j) {
                for (int px = 0; px < 2; ++px) {
                    const std::int64_t lanes =
                        (range_.count(0, static_cast<int>(o.x)) - px + 1) / 2;
                    if (lanes <= 0) {
                        continue;
                    }
                    row(slot, px, range_.lo.y + j, k, lanes);
                    Real* const to = out.row(slot, j) + px;
                    for (std::int64_t n = 0; n < lanes; ++n) {
                        to[2 * n] = best_[static_cast<std::size_t>(n)];
                    }
                }
            }
        }
    }

    [[nodiscard]] std::size_t heap() const {
        return (values_.size() + fine_.size()) * sizeof(Real) + (std::size_t{1} << 17U);
    }

  private:
    static constexpr std::int64_t kPhases = 8;
    static constexpr std::int64_t kRing = 8;
    static constexpr Real kNan = std::numeric_limits<Real>::quiet_NaN();

    [[nodiscard]] std::int64_t first_x() const { return 4 * range_.lo.x - kPhases; }
    /// Position in a row of the element i after first_x().
    [[nodiscard]] std::size_t split(std::int64_t i) const {
        return static_cast<std::size_t>((i & 7) * groups_ + (i >> 3));
    }
    [[nodiscard]] std::size_t row_start(std::int64_t y, std::int64_t z) const {
        return static_cast<std::size_t>(((z & (kRing - 1)) * rows_ + (y - low_y())) * kPhases *
                                        groups_);
    }
    void scatter(std::vector<Real>& to, std::int64_t y, std::int64_t z) {
        Real* const out = to.data() + row_start(y, z);
        for (std::size_t i = 0; i < line_.size(); ++i) {
            out[split(static_cast<std::int64_t>(i) + kPhases - 2)] = line_[i];
        }
    }
    /// The lanes' elements at offset x from their lattice node, in a row that starts at `start`.
    [[nodiscard]] static std::int64_t lane_offset(std::int64_t x, int px, std::int64_t groups) {
        const std::int64_t i = 4 * px + x + kPhases;
        return (i & 7) * groups + (i >> 3);
    }

    /// One point of a support with the places of its numbers in values_, relative to row 4 y of the
    /// ring. Holds for all rows and layers of the same parities.
    struct Step {
        Int3 at;
        std::int64_t value = 0;
        std::int64_t valid = 0;
        std::array<std::int64_t, 4> term{};
        std::array<Real, 4> weight{};
        int terms = 0;
    };
    const std::vector<Step>& steps(int slot, int px, int py, int pz);

    void row(int slot, int px, std::int64_t y, std::int64_t k, std::int64_t lanes);
    LayerRange range_;
    Int3 fine_cells_;
    std::int64_t rows_;
    std::int64_t groups_;
    std::vector<Real> values_;
    std::vector<Real> fine_;
    std::vector<Real> valid_;
    std::vector<Real> line_;
    std::array<std::vector<Step>, 8 * kSlots> steps_;
    std::vector<Real> best_;
    std::vector<Real> errors_;
    std::vector<Real> largest_;
};

extern template class DeviationKernel<float>;
extern template class DeviationKernel<double>;

}  // namespace isonest
