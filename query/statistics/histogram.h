// The histogram of a store's values, and the size of each isovalue's surface.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <type_traits>
#include <vector>

#include <isonest/histogram.h>
#include <isonest/progress.h>
#include <isonest/value_type.h>

#include "store/base/box.h"
#include "store/container/reader.h"

namespace isonest::detail {

// Which bin of a histogram contains a value.

/// Maximum number of bins of a histogram.
inline constexpr int kMaxBins = 256;

/// Thread-safety: const methods from any thread.
class BinFinder {
  public:
    /// REQUIRES: `bins` outlives this object and has a bin.
    explicit BinFinder(const ValueBins& bins);

    /// The last bin k with value >= bins.low[k]; the first bin for smaller values. REQUIRES: not
    /// NaN.
    [[nodiscard]] int operator()(double value) const {
        const double halves = bins_->integer ? value - first_ + kHalf : value / 2 - first_ / 2;
        // At most last_, even if the product is NaN.
        const double guess = halves * per_half_;
        int k = guess < last_ ? static_cast<int>(std::max(guess, 0.0)) : static_cast<int>(last_);
        if (!bins_->integer) {
            const std::vector<double>& low = bins_->low;
            while (k + 1 < static_cast<int>(low.size()) && value >= low[k + 1]) {
                ++k;
            }
            while (k > 0 && value < low[k]) {
                --k;
            }
        }
        return k;
    }

  private:
    static constexpr double kHalf = 0.5;  // keeps whole numbers away from rounding thresholds
    const ValueBins* bins_;
    double first_;
    double last_;
    double per_half_;
};

// How many nodes have a value, and how many cubes intersect an isosurface.
//
// Source: H. Carr, B. Duffy, B. Denby, "On Histograms and Isosurface Statistics", IEEE Transactions
// on Visualization and Computer Graphics 12 (2006): the number of cubes that a surface intersects
// measures its area better than the number of nodes near it.

/// The bin of a node's value, plus 1; 0 if the value is missing.
using BinCode = std::uint16_t;
inline constexpr BinCode kMissingCode = 0;

/// Sums that do not depend on the order of additions. Thread-safety: one thread.
class ValueCounts {
  public:
    explicit ValueCounts(int bins)
        : nodes_(static_cast<std::size_t>(bins) + 1),
          changes_(static_cast<std::size_t>(bins) + 1) {}

    /// Counts the first `own` nodes per axis of the box.
    void add_nodes(const Box<BinCode>& box, const Int3& own);
    /// For each of the first `cells` cubes per axis, counts the isovalues whose surface can pass
    /// through it: those above the bin of its smallest value, up to that of its largest. Missing
    /// values are ignored. Along an axis with one node, cubes have no extent. REQUIRES: cells <
    /// nodes of the box along the other axes.
    void add_cubes(const Box<BinCode>& box, const Int3& cells);
    /// Counts a cube with values in bins `low` to `high`; none if low > high.
    void add_cube(int low, int high) {
        if (low < high) {
            ++changes_[static_cast<std::size_t>(low) + 1];
            --changes_[static_cast<std::size_t>(high) + 1];
        }
    }
    void add(const ValueCounts& other);

    /// Number of nodes in each bin.
    [[nodiscard]] std::vector<std::uint64_t> nodes() const {
        return {nodes_.begin() + 1, nodes_.end()};
    }
    [[nodiscard]] std::uint64_t missing() const { return nodes_.front(); }
    /// For each bin, the number of cubes that intersect the surface at the bin's smallest value.
    [[nodiscard]] std::vector<std::uint64_t> cubes() const;

  private:
    std::vector<std::uint64_t> nodes_;  ///< by code
    /// For each bin, the number of cubes that begin minus those that end there, modulo 2^64; one
    /// more entry for the end of the last bin.
    std::vector<std::uint64_t> changes_;
};

// Suggested isovalues.
//
// Sources: V. Pekar, R. Wiemker, D. Hempel, "Fast Detection of Meaningful Isosurfaces for Volume
// Data Visualization", IEEE Visualization 2001: the boundary between two materials is where the
// mean gradient over the isosurface is largest. C. Scheidegger, J. Schreiner, B. Duffy, H. Carr, C.
// Silva, "Revisiting Histograms and Isosurface Statistics", IEEE Transactions on Visualization and
// Computer Graphics 14 (2008): by the coarea formula the number of nodes within a bin is the
// surface's area over the gradient, so cubes over nodes is that mean, the harmonic one.

/// The peaks of the ratio of cubes to nodes, at most five, the most prominent first:
/// 1. Neighbouring bins are merged until they have 1/65536 of the nodes, and at least 64. Only
///    those are kept whose surface has at least 1/100 of the cubes of the largest surface.
/// 2. Their cubes (the mean of those at both ends of a bin) and their nodes are summed over a
///    window that extends 1/32 of the kept bins to both sides; the curve is the quotient.
/// 3. A peak counts if it is 1.5 times as high as the valley between it and a higher one on either
///    side. The highest always counts.
/// The isovalue is the middle of the peak; for integers, half a number below one. `nodes`, `cubes`:
/// of each bin, the latter at its smallest value.
std::vector<SuggestedIsovalue> suggest_isovalues(const ValueBins& bins,
                                                 std::span<const std::uint64_t> nodes,
                                                 std::span<const std::uint64_t> cubes);

/// By default, the finest level is used that has at most this many nodes in the volume.
inline constexpr std::int64_t kMaxHistogramNodes = std::int64_t{1} << 28;

/// See <isonest/histogram.h>.
Histogram histogram(const StoreReader& store, const HistogramOptions& options, Progress& progress);

}  // namespace isonest::detail
