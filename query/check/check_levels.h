// Compares the levels of a store with each other, chunk by chunk.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <isonest/progress.h>

#include "query/check/findings.h"
#include "store/base/box.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"
#include "store/lattice/simplex.h"

namespace isonest::detail {

// The deviation of one cube's tetrahedra by definition: every node compared with the linear
// function.

struct LargestDifference {
    double difference = 0;  ///< +inf if a value is missing
    double size = 0;        ///< largest corner value, the reference for rounding errors
};

/// max |U - U_T| over the nodes of the six Kuhn tetrahedra T of a cube. `box` contains its nodes;
/// those beyond `last` are outside the volume and are ignored. Source: Gerstner, Rumpf, Weikard
/// (2000), section 4, eta*.
template <class T>
LargestDifference largest_difference(const Box<T>& box, const Int3& cube, std::int64_t edge,
                                     const Int3& last) {
    LargestDifference found;
    for (int order = 0; order < 6; ++order) {
        const Tetrahedron t = kuhn_tetrahedron(cube, edge, order);
        std::array<double, 4> corner{};
        for (std::size_t i = 0; i < 4; ++i) {
            corner[i] = static_cast<double>(box.at(t.v[i]));
            found.size = std::max(found.size, std::fabs(corner[i]));
        }
        const auto& axes = kAxisOrders[static_cast<std::size_t>(order)];
        for (std::int64_t i = 0; i < box.size.product(); ++i) {
            const Int3 p = box.lo + box.size.unlinear(i);
            std::array<double, 3> d{};
            for (std::size_t a = 0; a < 3; ++a) {
                d[a] = std::fabs(static_cast<double>(p[axes[a]] - t.v[0][axes[a]])) /
                       static_cast<double>(edge);
            }
            // Inside a Kuhn tetrahedron the coordinates descend along its axis order.
            if (d[0] < d[1] || d[1] < d[2] || max(p, last) != last) {
                continue;
            }
            const double linear = corner[0] * (1 - d[0]) + corner[1] * (d[0] - d[1]) +
                                  corner[2] * (d[1] - d[2]) + corner[3] * d[2];
            const double difference = std::fabs(static_cast<double>(box.at(p)) - linear);
            found.difference = std::isnan(difference) ? std::numeric_limits<double>::infinity()
                                                      : std::max(found.difference, difference);
        }
    }
    return found;
}

// Compares the ranges of cubes with the values that they bound.

/// Compares the planes of ranges with their checksums (if `quick`: a sample of at most 256 MiB)
/// and, unless `quick`, the ranges with the values of level 0 and of the finer level. Adds results
/// to `findings`, as test "cube range". With ranks, each compares its share; collective. For a
/// remote store, ranges that are not read are not checked. Throws Error{cancelled}.
void check_cube_ranges(const StoreReader& store, ChunkCache& cache, bool quick, Findings& findings,
                       Progress& progress, const RankShare& share);

/// Tests "injection" of values, "saturation" of indicators across chunk borders, and "indicator" of
/// those at level 1 that follow from the values. Adds results to `findings`. Throws Error{corrupt}
/// if a required chunk cannot be decoded. Thread-safe.
void check_levels(ChunkCache& cache, Findings& findings, const ArrayInfo& array, const Int3& chunk);

}  // namespace isonest::detail
