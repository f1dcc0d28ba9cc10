// The chunked consistency tests of a store, from cheap to expensive.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <isonest/progress.h>

#include "store/container/reader.h"

namespace isonest::detail {

/// One thing that is wrong.
struct Finding {
    /// "table", "checksum", "decode", "range", "injection", "saturation", "indicator", "cube
    /// range", "hdf5", "source" or "bound".
    std::string test;
    std::string field;
    int level = 0;
    Int3 chunk;
    Int3 node;  ///< on the finest lattice; {-1, -1, -1} if the chunk as a whole
    std::string message;
};

/// Reads rows [y0, y0 + ny) of planes [z0, z0 + nz) of the original volume into `out`, tightly
/// packed, in the store's value type.
using SourceReader = std::function<void(std::int64_t z0, std::int64_t nz, std::int64_t y0,
                                        std::int64_t ny, std::byte* out)>;

/// How the original volume is best read: in multiples of so many planes and rows, as other reads
/// may decode a chunk again; and whether only in ascending order, without gaps.
struct SourceOrder {
    std::int64_t planes = 1;
    std::int64_t rows = 1;
    bool sequential = false;
};

enum class CheckDepth {
    quick,     ///< the table, and a sample of the checksums of chunks and ranges: seconds
    standard,  ///< all that follows from the store's own bytes
    deep       ///< and that HDF5 finds the same chunks by its own index
};

struct CheckOptions {
    CheckDepth depth = CheckDepth::standard;
    SourceReader source;  ///< empty: no comparison with the original
    SourceOrder source_order;
    std::uint64_t memory = std::uint64_t{512} << 20U;
    int threads = 0;
    std::uint64_t sampled_cubes = 2000;  ///< cubes whose bounds are checked by brute force
};

struct CheckReport {
    std::uint64_t chunks = 0;  ///< of which the checksums were compared
    std::uint64_t nodes = 0;   ///< values and indicators compared
    std::uint64_t cubes = 0;   ///< bounds checked by brute force
    std::uint64_t failures = 0;
    std::vector<Finding> findings;  ///< the first 100
};

/// Runs all tests; damaged chunks are findings, and what depends on them is left out.
/// Throws Error{io, limit, cancelled}.
CheckReport check(const StoreReader& store, const CheckOptions& options, Progress& progress);

}  // namespace isonest::detail
