// The one chunk table and the one plan of the file: rank 0 has them, and tells each rank its part.
#pragma once

#include <span>

#include <isonest/progress.h>

#include "preprocess/ranks/pencils.h"
#include "store/container/format.h"
#include "store/container/writer.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// `own`: the rows of a rank's chunks, in the order of OwnChunks. Rank 0 gets all of them into the
/// table of `writer`, which others do not have (null). Collective.
void gather_rows(Communicator& ranks, const StoreLayout& layout, const Pencils& pencils,
                 std::span<const ChunkRow> own, StoreWriter* writer);

/// Rank 0's: the place of every chunk, as preprocess() writes them: block by block. Throws
/// Error{io}.
void plan_all_chunks(StoreWriter& writer, const Progress& progress);

/// Each rank gets the offsets of its chunks. Collective.
void spread_offsets(Communicator& ranks, const StoreLayout& layout, const Pencils& pencils,
                    std::span<ChunkRow> own, StoreWriter* writer);

}  // namespace isonest::detail
