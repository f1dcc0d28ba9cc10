// A store against the volume that it was made from.
#pragma once

#include "query/check/findings.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

/// Tests "source", all values of level 0 against options.source, and "bound", the bounds of cubes
/// drawn over all levels against brute force. Adds what it finds to `findings`; what damaged chunks
/// hide is left out. Throws Error{io, cancelled}.
void check_source(ChunkCache& cache, const CheckOptions& options, Findings& findings,
                  Progress& progress);

}  // namespace isonest::detail
