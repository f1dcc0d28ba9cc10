// The chunked consistency tests of a store, from cheap to expensive.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/volume_source.h>

#include "store/container/reader.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// One thing that is wrong.
struct Finding {
    /// "table", "checksum", "decode", "range", "injection", "saturation", "indicator", "cube
    /// range", "hdf5", "footer", "source" or "bound".
    std::string test;
    std::string field;
    int level = 0;
    Int3 chunk;
    Int3 node;  ///< on the finest lattice; {-1, -1, -1} if the chunk as a whole
    std::string message;
};

enum class CheckDepth {
    quick,     ///< the table, and a sample of the checksums of chunks and ranges: seconds
    standard,  ///< all that follows from the store's own bytes
    deep       ///< and that HDF5 finds the same chunks by its own index
};

struct CheckOptions {
    CheckDepth depth = CheckDepth::standard;
    /// The volume that the store was made from, not owned; null: no comparison with it.
    VolumeSource* source = nullptr;
    std::uint64_t memory = std::uint64_t{512} << 20U;
    int threads = 0;
    std::uint64_t sampled_cubes = 2000;  ///< cubes whose bounds are checked by brute force
    /// Each checks a share of the chunks, rank 0 the source, with memory and threads of its own;
    /// null: one process.
    Communicator* ranks = nullptr;
};

struct CheckReport {
    std::uint64_t chunks = 0;  ///< of which the checksums were compared
    std::uint64_t nodes = 0;   ///< values and indicators compared
    std::uint64_t cubes = 0;   ///< bounds checked by brute force
    std::uint64_t failures = 0;
    std::vector<Finding> findings;  ///< the first 100
};

/// Runs all tests; with ranks collective, and rank 0 has the report of all, which is that of one
/// process; what others return means nothing. Damaged chunks are findings, and what depends on them
/// is left out. Throws Error{invalid_argument} if options.source has other nodes or another type
/// than the store, Error{io, limit, cancelled}, and what the source throws.
CheckReport check(const StoreReader& store, const CheckOptions& options, Progress& progress);

}  // namespace isonest::detail
