// From a volume to a store: the bottom-up pass over all levels, out of core.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/volume_source.h>

namespace isonest {

struct PreprocessOptions {
    std::uint64_t memory = std::uint64_t{1} << 30U;  ///< bytes of heap, at most
    int threads = 0;                                 ///< 0 = all cores
    int chunk = 64;       ///< nodes per axis of a chunk: a power of two, 8 to 256
    int compression = 1;  ///< zstd level, 1 to 19
    bool exact = false;   ///< indicators as binary32 instead of 16-bit codes rounded up
    bool force = false;   ///< replace an existing store
    /// Go on from where an interrupted run for the same store stopped, if there is one, which must
    /// have had the same options and VolumeSource::identity() (not ""); and if this one is
    /// cancelled or fails, leave what it has done for the next.
    bool resume = false;
    std::vector<Field> fields = default_indicators();
};

struct PreprocessReport {
    Int3 nodes;
    int levels = 0;
    std::uint64_t input_bytes = 0;
    std::uint64_t store_bytes = 0;
    std::uint64_t chunks = 0;
    double min_value = 0;  ///< of labels of 64 bits: the label, rounded beyond 2^53
    double max_value = 0;
    /// Of labels of 64 bits, if a node has one: the smallest and the largest.
    std::optional<std::array<std::int64_t, 2>> labels = {};
    bool has_missing = false;          ///< non-finite values were found and treated as missing data
    std::uint64_t label_names = 0;     ///< labels whose name or colour the store has
    std::uint64_t resumed_chunks = 0;  ///< taken over from an interrupted run
    bool input_on_disk = false;  ///< the input was first copied to temporary space (little memory)
    double seconds = 0;
};

/// Reads `source` once and writes `store`, which appears under its name only when it is whole; a
/// file of that name is left alone unless options.force.
/// The bytes depend on the volume, chunk, compression, exact and fields alone.
/// Throws Error{invalid_argument, io, limit, cancelled} and what the source throws.
/// Thread-safety: several runs at once, each with a source and a store of its own.
PreprocessReport preprocess(VolumeSource& source, const std::filesystem::path& store,
                            const PreprocessOptions& options = {},
                            Progress& progress = silent_progress());

}  // namespace isonest
