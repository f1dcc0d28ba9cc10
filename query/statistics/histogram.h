// The histogram of a store's values, and how much surface each isovalue has.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <isonest/progress.h>

#include "query/statistics/isovalue_choice.h"
#include "query/statistics/value_bins.h"
#include "store/container/reader.h"

namespace isonest::detail {

/// Without a level asked for, the finest is taken that has no more nodes in the volume.
inline constexpr std::int64_t kMostHistogramNodes = std::int64_t{1} << 28;

struct HistogramOptions {
    std::optional<int> level = {};  ///< whose values are counted
    /// Cubes are those between the nodes that are looked at, whatever ranges the store has.
    bool own_cubes = false;
    std::uint64_t memory = std::uint64_t{512} << 20U;
    int threads = 0;
};

/// Does not depend on the threads or the memory.
struct Histogram {
    int dimension = 3;          ///< 3 less the flat axes
    int level = 0;              ///< whose nodes in the volume were looked at: every 2^level-th
    std::uint64_t looked = 0;   ///< at so many nodes,
    std::uint64_t missing = 0;  ///< of which so many are missing
    ValueBins bins;             ///< between the smallest and the largest value of all levels
    /// Of a store whose values stand for labels of 64 bits the smallest one, and `bins` are then of
    /// what labels are above it. There are no cubes and no suggestions.
    std::optional<std::int64_t> first_label = {};
    std::vector<std::uint64_t> nodes;  ///< of each bin
    /// Of which level the cubes below are (squares or edges, where axes are flat): that of the
    /// nodes if it is 0 or own_cubes was asked for, counted from their corners that are not
    /// missing; else that of the finest stored ranges; nothing if the store has none.
    std::optional<int> cube_level;
    /// Of each bin, the cubes that the isosurface at its smallest value passes through; more are
    /// counted only where values are missing, or ranges of 32- and 64-bit numbers are rounded.
    /// Empty without cube_level.
    std::vector<std::uint64_t> cubes;
    std::vector<SuggestedIsovalue> suggested;
};

/// Reads every value of one level once or, where the memory does not hold two layers of chunks,
/// twice. Throws Error{not_found} if there is no such level, Error{corrupt, limit, cancelled}.
Histogram histogram(const StoreReader& store, const HistogramOptions& options, Progress& progress);

}  // namespace isonest::detail
