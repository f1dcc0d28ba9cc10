// The histogram of a store's values, and the size of each isovalue's surface.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <isonest/progress.h>
#include <isonest/store.h>
#include <isonest/value_type.h>

namespace isonest {

/// Bins between the smallest and the largest value, at most 256. For integers, each bin has as many
/// whole numbers as needed to stay within that (one, if the values are less than 256 apart; the
/// last bin may have fewer). For other types there are 256 bins of equal width, or one if all
/// values are the same.
struct ValueBins {
    /// The smallest value of each bin, ascending. Some may be equal if doubles cannot distinguish
    /// them; all but the last of these bins then stay empty. Empty if there is no value.
    std::vector<double> low;
    double end = 0;  ///< end of the last bin: for integers the next one, otherwise the last value
    bool integer = false;  ///< whole numbers

    ValueBins() = default;
    /// For values of this type from `lowest` to `highest`; no bins if lowest > highest.
    ValueBins(ValueType type, double lowest, double highest);
    [[nodiscard]] int count() const { return static_cast<int>(low.size()); }
};

/// A peak of the ratio of cubes to nodes: probably the boundary between two materials.
struct SuggestedIsovalue {
    double isovalue = 0;
    std::uint64_t cubes = 0;  ///< number of cubes that intersect its surface

    bool operator==(const SuggestedIsovalue&) const = default;
};

struct HistogramOptions {
    /// Level whose values are counted; nothing: the finest level with at most 2^28 nodes in the
    /// volume.
    std::optional<int> level = {};
    /// Count cubes between the nodes that are read, even if the store has ranges.
    bool own_cubes = false;
    std::uint64_t memory = std::uint64_t{512} << 20U;  ///< maximum bytes of heap
    int threads = 0;                                   ///< 0 = all cores
};

/// Does not depend on the threads or the memory.
struct Histogram {
    int dimension = 3;          ///< 3 less the flat axes
    int level = 0;              ///< level whose nodes in the volume were read: every 2^level-th
    std::uint64_t looked = 0;   ///< number of nodes read
    std::uint64_t missing = 0;  ///< number of these that are missing
    ValueBins bins;             ///< between the smallest and the largest value of all levels
    /// For a store whose values represent 64-bit labels: the smallest label; `bins` are then
    /// relative to it. There are no cubes and no suggestions.
    std::optional<std::int64_t> first_label = {};
    std::vector<std::uint64_t> nodes;  ///< of each bin
    /// Level of the cubes below (squares or edges, if axes are flat): that of the nodes if it is 0
    /// or own_cubes was requested, counted from their corners that are not missing; otherwise that
    /// of the finest stored ranges; nothing if the store has none.
    std::optional<int> cube_level;
    /// For each bin, the number of cubes that intersect the isosurface at its smallest value; too
    /// many are counted only where values are missing, or ranges of 32- and 64-bit numbers are
    /// rounded. Empty without cube_level.
    std::vector<std::uint64_t> cubes;
    std::vector<SuggestedIsovalue> suggested;  ///< at most five, the most prominent first
};

/// Reads every value of one level once or, if the memory is too small for two layers of chunks,
/// twice. Throws Error{not_found} if there is no such level, Error{corrupt, io, limit, cancelled}.
/// Thread-safety: any number of concurrent calls.
Histogram histogram(const Store& store, const HistogramOptions& options = {},
                    Progress& progress = silent_progress());

}  // namespace isonest
