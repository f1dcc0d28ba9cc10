// The error of P U as section 3 of the paper defines it: norms of the difference of the functions
// and of their gradients, integrated over the volume.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 3.
#pragma once

#include "query/study/whole_lattice.h"

namespace isonest::detail {

/// Norms over the elements of the finest level without missing data.
struct TrueNorms {
    double value = 0;          ///< of P U - U in L^p, over the range and the volume's size^(1/p)
    double gradient = 0;       ///< of grad P U - grad U in L^p, over that of grad U
    double gradient_linf = 0;  ///< its largest length, over that of grad U
};

class TrueError {
  public:
    /// p = `power`, at least 1 and at most kMostPower. `range`: of the values, more than 0. Loads
    /// nothing: the lattice has its values. REQUIRES: the lattice outlives this; its dimension is
    /// at least 1.
    TrueError(const WholeLattice& whole, const Double3& spacing, double range, double power);

    /// Of the lattice's present projection. Exact but for rounding: U and P U are linear on the
    /// elements of the finest level. The same for any number of threads, which are the arena's.
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

}  // namespace isonest::detail
