// Consistency tests of a store, chunk by chunk, from cheap to expensive.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/store.h>
#include <isonest/volume_source.h>

namespace isonest {

/// A detected error.
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
    quick,     ///< the table, and a sample of the checksums of chunks and ranges; takes seconds
    standard,  ///< everything that can be verified from the store alone
    deep       ///< also that HDF5's own index finds the same chunks
};

struct CheckOptions {
    CheckDepth depth = CheckDepth::standard;
    /// The volume from which the store was made, not owned; null: not compared.
    VolumeSource* source = nullptr;
    std::uint64_t memory = std::uint64_t{512} << 20U;  ///< maximum bytes of heap
    int threads = 0;                                   ///< 0 = all cores
    std::uint64_t sampled_cubes = 2000;  ///< number of cubes whose bounds are checked by brute
                                         ///< force; needs a source
};

struct CheckReport {
    std::uint64_t chunks = 0;  ///< number of chunks whose checksums were compared
    std::uint64_t nodes = 0;   ///< number of values and indicators compared
    std::uint64_t cubes = 0;   ///< number of bounds checked by brute force
    std::uint64_t failures = 0;
    std::vector<Finding> findings;  ///< the first 100
};

/// Runs all tests. Damaged chunks are reported as findings, and tests that depend on them are
/// skipped. The report does not depend on the threads or the memory. Throws Error{invalid_argument}
/// if options.source has a different type or number of nodes than the store, Error{io, limit,
/// cancelled}, and what the source throws. Thread-safety: any number of concurrent calls, each with
/// its own source.
CheckReport check(const Store& store, const CheckOptions& options = {},
                  Progress& progress = silent_progress());

}  // namespace isonest
