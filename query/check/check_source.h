// Compares a store with the volume from which it was made.
#pragma once

#include <isonest/progress.h>
#include <isonest/volume_source.h>

#include "query/check/check.h"
#include "query/check/findings.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"

namespace isonest::detail {

/// Throws Error{invalid_argument} unless both have the same nodes and type.
void require_same_shape(const StoreReader& store, const VolumeSource& source);

/// Tests "source", all values of level 0 against *options.source, and "bound", the bounds of cubes
/// sampled from all levels against brute force. Adds results to `findings`; data in damaged chunks
/// is skipped. Throws Error{io, cancelled}.
void check_source(ChunkCache& cache, const CheckOptions& options, Findings& findings,
                  Progress& progress);

}  // namespace isonest::detail
