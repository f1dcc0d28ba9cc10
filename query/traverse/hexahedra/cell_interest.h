// SimplexIsOfInterest on cells of a volume.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "query/traverse/hexahedra/cell_walk.h"
#include "query/traverse/hexahedra/hex_projection.h"
#include "query/traverse/interest.h"

namespace isonest::detail {

/// Whether the query's surface or plane may pass through the cell; `number`: of the cell. Throws
/// what the cache of the projection throws.
inline bool is_of_interest(const TraversalQuery& query, HexProjection& projection, const Cell& cell,
                           double number) {
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    for (unsigned i = 0; i < 8; ++i) {
        const Int3 node = cell.low() + corner_offset(i) * cell.edge();
        const double value =
            query.plane ? query.plane->distance(node) : projection.exact(node, cell.level);
        if (!std::isfinite(value)) {
            return cell.level > 0;
        }
        low = std::min(low, value);
        high = std::max(high, value);
    }
    if (query.plane) {
        return low < 0 && high >= 0;
    }
    // |U - P U| is below the threshold, |U - U_C| at most the number.
    return may_reach(low, high, number + query.tolerance.threshold(), query.iso);
}

}  // namespace isonest::detail
