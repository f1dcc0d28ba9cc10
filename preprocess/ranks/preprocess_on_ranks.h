// preprocess() on several ranks, on one machine or on several with a common file system.
#pragma once

#include <cstdint>
#include <filesystem>

#include <isonest/preprocess.h>
#include <isonest/progress.h>
#include <isonest/volume_source.h>

#include "store/ranks/communicator.h"

namespace isonest::detail {

/// What preprocess_on_ranks() has done; `whole` at rank 0, the rest for each rank's own part.
struct RanksReport {
    PreprocessReport whole;
    std::uint64_t input_bytes = 0;  ///< read; those that other ranks read too are in theirs as well
    std::uint64_t store_bytes = 0;  ///< of the chunks that it made
    double passes = 0;              ///< seconds, reading the input included
    double writing = 0;             ///< seconds, until they were on the disk
    double alone = 0;               ///< seconds, of rank 0: what nobody else could help with
};

/// Writes the store that preprocess() writes, byte for byte, for any number of ranks. Each rank
/// reads its own part of `source` (every rank has one of its own, for the same input), within
/// options.memory and options.threads, and has its temporary files in `scratch` (empty: the store's
/// folder), which others need not see. `progress`: that of this rank's part. Collective.
/// With options.resume, what ranks of an interrupted run have done of levels 0 to 2 is taken over
/// from the scratch folders that this run's ranks see, however many those were; and it is left
/// there if this one fails. Throws on the rank that fails what preprocess() throws,
/// Error{invalid_argument} if ranks see different inputs, options or output folders, and
/// Error{unsupported} on more than one rank for an input that can only be read in order; on the
/// others Error{cancelled}.
RanksReport preprocess_on_ranks(Communicator& ranks, VolumeSource& source,
                                const std::filesystem::path& store,
                                const PreprocessOptions& options,
                                const std::filesystem::path& scratch, Progress& progress);

}  // namespace isonest::detail
