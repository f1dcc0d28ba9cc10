// The error of P U on a plane through a volume.
#pragma once

#include "query/study/whole_lattice.h"

namespace isonest::detail {

/// Norms of P U - U over the part of the plane in the volume, without missing data, relative to
/// `range` and to the part's area. Exact but for rounding: U and P U are linear on the polygon in
/// which the plane cuts an element of the finest level. All are 0 where the plane misses the
/// volume. The same for any number of threads, which are those of the arena. REQUIRES: a volume
/// with an extent along each axis.
ErrorNorms plane_error(const WholeLattice& whole, const LatticePlane& plane, const Double3& spacing,
                       double range);

}  // namespace isonest::detail
