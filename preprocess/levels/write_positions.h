// Writes the positions of the nodes of a curvilinear grid.
#pragma once

#include <cstdint>
#include <filesystem>

#include <isonest/curved_nodes.h>
#include <isonest/progress.h>
#include <isonest/volume_source.h>

#include "store/container/format.h"
#include "store/container/writer.h"

namespace isonest::detail {

/// The least memory for that beside the source of the values, including the sources of positions.
std::uint64_t position_heap(const NodePositions& positions, const StoreLayout& layout);

/// Writes all chunks of positions, one layer of chunks after the other, and tells the writer what
/// they are as a whole. Their bytes do not depend on memory and threads. `memory`: maximum bytes to
/// hold, at least position_heap(); `tokens`: chunks under way. Throws Error{invalid_argument} for
/// positions that are not finite or too large, and if all nodes lie in one place along an axis of
/// the lattice; and what the sources throw.
CurvedNodes write_positions(const NodePositions& positions, StoreWriter& writer,
                            std::uint64_t memory, int tokens,
                            const std::filesystem::path& scratch_folder, Progress& progress);

}  // namespace isonest::detail
