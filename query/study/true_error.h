// The error of P U as defined in section 3 of the paper: norms of the difference of the functions
// and of their gradients, integrated over the volume.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 3.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include <isonest/int3.h>
#include <isonest/study.h>

#include "query/study/whole_lattice.h"
#include "query/traverse/adapt_traverse.h"

namespace isonest::detail {

// The mean of a power of a linear function over a simplex.
//
// Source: the formula of Hermite and Genocchi: the mean of F^(n) over a simplex of dimension n on
// which x is linear is n! times the divided difference of F at the values at its n + 1 vertices; C.
// de Boor, "Divided differences", Surveys in Approximation Theory 1 (2005).

/// The mean of |x|^power over a simplex, where x is linear with these values at its vertices. Exact
/// apart from rounding (a relative error of about 1e-9), also where x changes its sign. REQUIRES: 1
/// to 4 finite values, 1 <= power <= kMaxPower. Thread-safe.
double mean_of_power(std::span<const double> values, double power);
inline constexpr double kMaxPower = 64;

// The elements of the finest level in a slab of the volume, cell by cell.
//
// Source: Maubach (1995), as in store/lattice/lattice.h: an element walks along the axes from the
// all-even corner of its cell to the all-odd one.

/// The order in which an element of the finest level walks along the axes.
template <int D>
struct AxisWalk {
    std::array<std::size_t, D> axes{};
};

/// The D! walks of a lattice of dimension D.
template <int D>
std::vector<AxisWalk<D>> axis_walks(const Lattice& lattice) {
    std::vector<AxisWalk<D>> walks;
    for (const Element<D>& t : coarsest_elements<D>(lattice)) {
        AxisWalk<D> walk;
        for (std::size_t i = 0; i < D; ++i) {
            const Int3 step = t.v[i + 1] - t.v[i];
            walk.axes[i] = step.x != 0 ? 0 : step.y != 0 ? 1 : 2;
        }
        walks.push_back(walk);
    }
    return walks;
}

/// The nodes of the element of the cell whose low corner is `cell`.
template <int D>
std::array<Int3, D + 1> finest_element(const Int3& cell, const AxisWalk<D>& walk) {
    std::array<Int3, D + 1> v;
    v[0] = cell;
    for (std::size_t i = 0; i < D; ++i) {
        const int axis = static_cast<int>(walk.axes[i]);
        v[0][axis] += cell[axis] & 1;
    }
    for (std::size_t i = 0; i < D; ++i) {
        const int axis = static_cast<int>(walk.axes[i]);
        v[i + 1] = v[i];
        v[i + 1][axis] += (cell[axis] & 1) != 0 ? -1 : 1;
    }
    return v;
}

class TrueError {
  public:
    /// p = `power`, at least 1 and at most kMaxPower. `range`: of the values, greater than 0. Does
    /// not load anything: the lattice has its values. REQUIRES: the lattice outlives this object;
    /// its dimension is at least 1.
    TrueError(const WholeLattice& whole, const Double3& spacing, double range, double power);

    /// Norms for the lattice's current projection. Exact apart from rounding: U and P U are linear
    /// on the elements of the finest level. The same for any number of threads, which are the
    /// arena's.
    [[nodiscard]] TrueNorms measure() const;

  private:
    struct Sums;
    template <int D>
    [[nodiscard]] Sums integrate(bool of_data) const;
    [[nodiscard]] Sums integrate(bool of_data) const;

    const WholeLattice& whole_;
    Double3 spacing_;
    double range_;
    double power_;
    double size_ = 0;           ///< volume of the elements without missing data
    double gradient_ = 0;       ///< integral of |grad U|^p
    double gradient_linf_ = 0;  ///< largest |grad U|
};

// The error of P U on a plane through a volume.

/// Norms of P U - U over the part of the plane in the volume, without missing data, relative to
/// `range` and to the part's area. Exact apart from rounding: U and P U are linear on the polygon
/// in which the plane cuts an element of the finest level. All are 0 if the plane misses the
/// volume. The same for any number of threads, which are those of the arena. REQUIRES: a volume
/// with an extent along each axis.
ErrorNorms plane_error(const WholeLattice& whole, const LatticePlane& plane, const Double3& spacing,
                       double range);

}  // namespace isonest::detail
