// Whether an interrupted run's finished values are those of the input.
#pragma once

#include <isonest/volume_source.h>

#include "preprocess/levels/run_journal.h"
#include "store/container/chunk_source.h"

namespace isonest::detail {

/// Compares the first and the last plane that `done` covers with those of `store`. A source that
/// can only be read in order is not compared. Throws Error{invalid_argument} naming the place where
/// they differ, and what the source throws.
void require_same_values(VolumeSource& source, const ChunkSource& store, const Checkpoint& done);

}  // namespace isonest::detail
