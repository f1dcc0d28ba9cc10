// The chunk table and the plan of the file: rank 0 has them, and sends each rank its part.
#pragma once

#include <span>

#include <isonest/progress.h>

#include "preprocess/levels/centre_store.h"
#include "preprocess/ranks/pencils.h"
#include "store/container/format.h"
#include "store/container/writer.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// `own`: the rows of a rank's chunks, in the order of OwnChunks. Rank 0 collects all rows in the
/// table of `writer`, which is null on other ranks. Collective.
void gather_rows(Communicator& ranks, const StoreLayout& layout, const Pencils& pencils,
                 std::span<const ChunkRow> own, StoreWriter* writer);

/// On rank 0: plans the place of every chunk as preprocess() would write them, block by block.
/// Throws Error{io}.
void plan_all_chunks(StoreWriter& writer, const Progress& progress);

/// Sends each rank the offsets of its chunks. Collective.
void spread_offsets(Communicator& ranks, const StoreLayout& layout, const Pencils& pencils,
                    std::span<ChunkRow> own, StoreWriter* writer);

// Collects the finest ranges of cubes of all ranks on rank 0.

/// Rank 0 receives the ranges from the pencils of the others, and reserves space for all levels.
/// Collective. Throws Error{io}.
void gather_cube_ranges(Communicator& ranks, const StoreLayout& layout, const Pencils& pencils,
                        CentreStore& centres);

}  // namespace isonest::detail
