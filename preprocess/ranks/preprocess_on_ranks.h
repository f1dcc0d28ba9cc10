// preprocess() on several ranks, on one machine or on several with a common file system.
#pragma once

#include <cstdint>
#include <filesystem>

#include <isonest/preprocess.h>
#include <isonest/progress.h>
#include <isonest/volume_source.h>

#include "store/ranks/communicator.h"

namespace isonest::detail {

// Checks what must be the same on all ranks before they work together.

/// Throws on rank 0 if ranks see different inputs, or were given different options; the error lists
/// the ranks. Collective. Throws Error{invalid_argument}.
void require_same_work(Communicator& ranks, const VolumeSource& source,
                       const PreprocessOptions& options);

/// Report of preprocess_on_ranks(); `whole` is for rank 0, the rest for each rank's own part.
struct RanksReport {
    PreprocessReport whole;
    std::uint64_t input_bytes = 0;  ///< bytes read; parts that several ranks read are counted by
                                    ///< each
    std::uint64_t store_bytes = 0;  ///< of the chunks that this rank made
    double passes = 0;              ///< seconds, including reading the input
    double writing = 0;             ///< seconds until the chunks were on disk
    double alone = 0;               ///< seconds of rank 0 in which the others could not help
};

/// Writes the same store as preprocess(), byte for byte, for any number of ranks. Each rank reads
/// its own part of `source` (every rank has its own object for the same input), within
/// options.memory and options.threads. Its temporary files are in `scratch` (empty: the store's
/// folder), which other ranks need not see. `progress`: of this rank's part. Collective.
/// With options.resume, the blocks of levels 0 to 2 that ranks of an interrupted run have finished
/// are taken over from the scratch folders visible to the ranks of this run, whatever the number of
/// ranks then; and they are kept if this run fails.
/// The rank that fails throws what preprocess() throws, Error{invalid_argument} if ranks see
/// different inputs, options or output folders, and Error{unsupported} on more than one rank for an
/// input that can only be read in order; the others throw Error{cancelled}.
RanksReport preprocess_on_ranks(Communicator& ranks, VolumeSource& source,
                                const std::filesystem::path& store,
                                const PreprocessOptions& options,
                                const std::filesystem::path& scratch, Progress& progress);

}  // namespace isonest::detail
