// A store against the volume that it was made from.
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
/// drawn over all levels against brute force. Adds what it finds to `findings`; what damaged chunks
/// hide is left out. Throws Error{io, cancelled}.
void check_source(ChunkCache& cache, const CheckOptions& options, Findings& findings,
                  Progress& progress);

}  // namespace isonest::detail
