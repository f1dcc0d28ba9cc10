// From a volume to a store: the bottom-up pass over all levels, out of core.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include <isonest/curved_nodes.h>
#include <isonest/data_rounding.h>
#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/own_indicator.h>
#include <isonest/progress.h>
#include <isonest/volume_source.h>

namespace isonest {

struct PreprocessOptions {
    std::uint64_t memory = std::uint64_t{1} << 30U;  ///< maximum heap in bytes
    int threads = 0;                                 ///< 0 = all cores
    int chunk = 64;       ///< nodes per axis of a chunk: a power of two, 8 to 256
    int compression = 1;  ///< zstd level, 1 to 19
    bool exact = false;   ///< store indicators as binary32 instead of 16-bit codes rounded up
    bool force = false;   ///< replace an existing store
    /// Continue an interrupted run for the same store, if there is one; it must have had the same
    /// options and the same VolumeSource::identity() (not ""). If this run is cancelled or fails,
    /// it keeps its results for the next run.
    bool resume = false;
    std::vector<Field> fields = default_indicators();
    /// Up to kMaxOwnIndicators indicators of the caller. Each is stored with both saturations, in
    /// addition to `fields`.
    std::vector<OwnIndicator> own = {};
    /// Rounds all values before anything else; a rounding of rounding_of() (tolerance.h) for their
    /// type. The store says so, and its error bounds are for the given values. Refused for labels.
    DataRounding rounding = {};
};

struct PreprocessReport {
    Int3 nodes;
    int levels = 0;
    std::uint64_t input_bytes = 0;
    std::uint64_t store_bytes = 0;
    std::uint64_t chunks = 0;
    double min_value = 0;  ///< labels of 64 bits: the label, rounded above 2^53
    double max_value = 0;
    /// For labels of 64 bits: the smallest and the largest label, if any node has one.
    std::optional<std::array<std::int64_t, 2>> labels = {};
    bool has_missing = false;          ///< non-finite values were found and treated as missing data
    std::uint64_t label_names = 0;     ///< number of labels with a name or colour in the store
    std::uint64_t resumed_chunks = 0;  ///< reused from an interrupted run
    CurvedNodesPtr curved = {};  ///< of a curvilinear grid: its nodes as a whole, folded cells
    bool input_on_disk = false;  ///< the input was first copied to temporary space (low memory)
    double seconds = 0;
};

/// Reads `source` once and writes `store`. The store appears under its name only when it is
/// complete; an existing file of that name is not replaced unless options.force is set. The bytes
/// of the store depend only on the volume, chunk, compression, exact, fields, own and
/// rounding. Throws
/// Error{invalid_argument, unsupported, io, limit, cancelled} and what the source and own
/// indicators throw.
/// Thread-safety: several runs may execute at once, each with its own source and store.
PreprocessReport preprocess(VolumeSource& source, const std::filesystem::path& store,
                            const PreprocessOptions& options = {},
                            Progress& progress = silent_progress());

}  // namespace isonest
