// preprocess() on several ranks, on one machine or on several with a common file system.
#pragma once

#include <filesystem>

#include <isonest/preprocess.h>
#include <isonest/progress.h>
#include <isonest/volume_source.h>

#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Writes the store that preprocess() writes, byte for byte, for any number of ranks. Each rank
/// reads its own part of `source` (every rank has one of its own, for the same input), within
/// options.memory and options.threads, and has its temporary files in `scratch` (empty: the store's
/// folder), which others need not see. `progress`: that of this rank's part. Collective.
/// Rank 0's report is whole; the others' have their nodes alone.
/// Throws on the rank that fails what preprocess() throws, Error{invalid_argument} if ranks see
/// different inputs, options or output folders, and Error{unsupported} for options.resume and, with
/// more than one rank, for an input that can only be read in order; on the others
/// Error{cancelled}.
PreprocessReport preprocess_on_ranks(Communicator& ranks, VolumeSource& source,
                                     const std::filesystem::path& store,
                                     const PreprocessOptions& options,
                                     const std::filesystem::path& scratch, Progress& progress);

}  // namespace isonest::detail
