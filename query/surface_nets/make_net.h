// The surface net of a store's labels, in one traversal for all of them.
//
//     planes of nodes -> layers of cells, moved   query/surface_nets/net_block.h
//     layers          -> pieces in a file         query/surface_nets/net_store.h
//     a label's parts -> its mesh                 query/surface_nets/net_mesh.h
//
// Guarantees of these meshes, with proofs: query/LABELS.md.
#pragma once

#include <cstdint>
#include <string>

#include <isonest/labels.h>
#include <isonest/progress.h>

#include "query/surface_nets/net_block.h"
#include "query/surface_nets/net_store.h"
#include "store/base/memory.h"
#include "store/container/reader.h"

namespace isonest::detail {

// The division of a surface net's cells into blocks, and the number of concurrent blocks.

/// The result does not depend on it.
struct NetPlan {
    Int3 lo{};      ///< first cell to process
    Int3 hi{};      ///< end of the cells (exclusive)
    Int3 block{};   ///< cells along each axis, a multiple of kPieceCells
    Int3 blocks{};  ///< along each axis
    int threads = 1;
    std::uint64_t cache = 0;  ///< bytes for decoded chunks that are not held by a block

    [[nodiscard]] Int3 first_cell(const Int3& number) const {
        return lo + Int3{number.x * block.x, number.y * block.y, number.z * block.z};
    }
};

/// A plan for the cells [lo, hi), extended to whole pieces. Fewer threads are used if there is
/// little memory. Larger blocks duplicate less work around them. Throws Error{limit} if there is
/// too little memory.
NetPlan net_plan(const NetSetting& setting, const ArrayInfo& array, const Int3& lo, const Int3& hi,
                 const MemoryShare& memory);

/// Statistics of the reads of the traversal.
struct NetCounts {
    std::uint64_t blocks = 0;
    std::uint64_t chunks_read = 0;
    std::uint64_t bytes_read = 0;
    std::uint64_t peak_cache_bytes = 0;
};

/// The range of cells (end exclusive) in which a label can have vertices if its nodes are in [low,
/// high].
std::pair<Int3, Int3> cells_of_label(const Label& label);

/// Fills `net` with the surfaces of the labels, and seals it. `labels`: those of setting.wanted,
/// with their extents. Blocks that contain none of them are skipped. Throws Error{unsupported} for
/// values that are not labels, Error{corrupt, io, cancelled}. REQUIRES: the plan's cells contain
/// those of all labels.
NetCounts make_net(const StoreReader& store, const NetSetting& setting, const NetPlan& plan,
                   std::span<const Label> labels, NetStore& net, Progress& progress);

}  // namespace isonest::detail
