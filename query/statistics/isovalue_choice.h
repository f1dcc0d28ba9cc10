// Isovalues that are worth a look.
//
// Sources: V. Pekar, R. Wiemker, D. Hempel, "Fast Detection of Meaningful Isosurfaces for Volume
// Data Visualization", IEEE Visualization 2001: the boundary between two materials is where the
// gradient is largest on the mean over the isosurface. C. Scheidegger, J. Schreiner, B. Duffy, H.
// Carr, C. Silva, "Revisiting Histograms and Isosurface Statistics", IEEE Transactions on
// Visualization and Computer Graphics 14 (2008): by the coarea formula the nodes within a bin are
// the surface's area over the gradient, so that cubes over nodes are that mean, the harmonic one.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "query/statistics/value_bins.h"

namespace isonest::detail {

struct SuggestedIsovalue {
    double isovalue = 0;
    std::uint64_t cubes = 0;  ///< that its surface passes through

    bool operator==(const SuggestedIsovalue&) const = default;
};

/// The peaks of the cubes over the nodes, at most five, the one that stands out most first:
/// 1. Neighbouring bins are put together until they have 1/65536 of the nodes, and at least 64. Of
///    them those stay whose surface has at least 1/100 of the cubes that the largest surface has.
/// 2. Their cubes (the mean of those at both ends of a bin) and their nodes are added up over a
///    window that reaches 1/32 of what stayed to both sides; the curve is the quotient.
/// 3. A peak counts that is 1.5 times as high as the valley between it and a higher one on either
///    side. The highest always counts.
/// The isovalue is the middle of the peak: of integers, half a number below one.
/// `nodes`, `cubes`: of each bin, the latter at its smallest value.
std::vector<SuggestedIsovalue> suggest_isovalues(const ValueBins& bins,
                                                 std::span<const std::uint64_t> nodes,
                                                 std::span<const std::uint64_t> cubes);

}  // namespace isonest::detail
