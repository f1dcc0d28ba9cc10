// The deviation indicator: the largest difference between the finest function and a tetrahedron's
// linear function.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 4, eta*_infinity(x) = |U - U^l| over the support
// of x, which the paper considers too expensive. Here it is computed in a stream, from the values
// two levels finer (stride 2^(L-2)) and the deviation D already known there:
//   D(T) <= max over the finer T' in T of (max over vertices v of T' of |U(v) - U_T(v)| + D(T')),
// which is exact at levels 1 and 2, where D(T') = 0.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/indicators/layer.h"

namespace isonest::detail {

// The input of a node's deviation: points, interpolation weights, finer cubes.

/// The support of one refinement node of level L, in units of the lattice of level L-2, relative to
/// the lattice node that owns it. Derived from explicit bisection.
struct DeviationSupport {
    struct Term {
        Int3 at;
        double weight;
    };
    /// A node of the support, and the linear interpolation there in the tetrahedron that contains
    /// it.
    struct Point {
        Int3 at;
        std::vector<Term> terms;  ///< only those with a non-zero weight; empty for a vertex
                                  ///< (difference 0)
    };
    /// A cube of level L-2 with tetrahedra inside the support, and the points that are their
    /// vertices.
    struct Cube {
        Int3 low;
        std::vector<std::uint16_t> points;
    };
    std::vector<Point> points;
    std::vector<Cube> cubes;
};

/// The support of the node in `slot` of a lattice node whose coordinates have these parities.
/// `flat`: bits of the flat axes, 0 in slot; the support then consists of triangles or edges, and
/// its cubes are squares or edges. Thread-safe; the tables are created once.
const DeviationSupport& deviation_support(int slot, int parity_x, int parity_y, int parity_z,
                                          unsigned flat);

/// Computes the unsaturated deviation of the nodes of level L >= 2, layer by layer. Coordinates of
/// values and finer cubes are those of level L-2. A plane of values is stored as 8 x 8 arrays, one
/// for each (y mod 8, x mod 8). So for all nodes of a layer with the same parities, one point of
/// their supports is contiguous in memory: the nodes are the lanes of the kernels.
template <class Real>
class DeviationKernel {
  public:
    /// `fine_cells`: cubes of level L-2 per axis. `with_fine`: whether level L-2 has deviations of
    /// its own (L > 2). `flat`: bits of the flat axes. `outward`: the differences are at least the
    /// exact ones, see Interpolation. REQUIRES: range.lo.x is even.
    DeviationKernel(const LayerRange& range, const Int3& fine_cells, bool with_fine, unsigned flat,
                    bool outward);

    /// Coordinates that a plane of values or finer deviations must cover: x and y from low to high,
    /// inclusive.
    [[nodiscard]] std::int64_t low_x() const { return 4 * range_.lo.x - 2; }
    [[nodiscard]] std::int64_t high_x() const { return 4 * range_.hi.x + 2; }
    [[nodiscard]] std::int64_t low_y() const { return 4 * range_.lo.y - 2; }
    [[nodiscard]] std::int64_t high_y() const { return 4 * range_.hi.y + 2; }

    /// Loads plane z: value(y, out) writes the values at x = low_x() .. high_x() of row y (clamped
    /// outside the volume, 0 if missing); fine(y, out) likewise D of the finer cubes, NaN if there
    /// is no cube. REQUIRES: called for z = 4k - 2 .. 4k + 4 before layer k, in order.
    template <class Value, class Fine>
    void load_plane(std::int64_t z, Value&& value, Fine&& fine) {
        line_.resize(static_cast<std::size_t>(high_x() - low_x() + 1));
        for (std::int64_t y = low_y(); y <= high_y(); ++y) {
            value(y, line_.data());
            scatter(values_.data() + ring_start(z), y);
            if (!fine_.empty()) {
                fine(y, line_.data());
                scatter(fine_.data() + ring_start(z), y);
            }
        }
    }

    /// Computes slots 0 to 2 (first = 0, last = 2) or 3 to 6 of layer k.
    void layer(std::int64_t k, int first_slot, int last_slot, Layer<Real>& out);

  private:
    static constexpr std::int64_t kPhases = 8;
    static constexpr std::int64_t kRing = 8;

    /// Nodes of a layer with the same slot and parities: rows j = first, first + 2 .. of the range,
    /// in each row the columns px, px + 2 .. .
    struct Lanes {
        int slot;
        int px;
        int py;
        std::int64_t first;
        std::int64_t count;
    };
    /// One point of a support, with the offsets of its numbers in values_, relative to the first
    /// lane's.
    struct Step {
        std::int64_t z = 0;
        std::int64_t value = 0;
        std::int64_t valid = 0;
        std::array<std::int64_t, 4> term{};
        std::array<Real, 4> weight{};
        int terms = 0;
    };

    [[nodiscard]] std::int64_t plane_size() const { return kPhases * kPhases * groups_.product(); }
    [[nodiscard]] std::int64_t ring_start(std::int64_t z) const {
        return (z & (kRing - 1)) * plane_size();
    }
    /// Offset in a plane of the element at `at`, relative to the first lattice node of the range.
    [[nodiscard]] std::int64_t place(std::int64_t at_x, std::int64_t at_y) const;
    void scatter(Real* plane, std::int64_t y) const;
    const std::vector<Step>& steps(const Lanes& lanes, int pz);
    void raise_points(const Lanes& lanes, std::int64_t k);
    void raise_cubes(const Lanes& lanes, std::int64_t k);

    LayerRange range_;
    Int3 fine_cells_;
    unsigned flat_;
    bool outward_;
    Int3 groups_;  ///< x and y: elements per row and rows of each of a plane's 64 arrays; z is 1
    std::vector<Real> values_;
    std::vector<Real> fine_;
    std::vector<Real> valid_;  ///< like one plane: 0 inside the volume, NaN outside; empty if all 0
    std::vector<Real> line_;
    std::array<std::vector<Step>, 8 * kSlots> steps_;
    std::vector<Real> best_;
    std::vector<Real> errors_;
    std::vector<Real> largest_;
};

extern template class DeviationKernel<float>;
extern template class DeviationKernel<double>;

}  // namespace isonest::detail
