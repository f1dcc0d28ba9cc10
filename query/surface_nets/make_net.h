// The surface net of a store's labels, in one traversal for all of them.
//
//     planes of nodes -> layers of cells, moved   query/surface_nets/net_block.h
//     layers          -> pieces in a file         query/surface_nets/net_store.h
//     a label's parts -> its mesh                 query/surface_nets/net_mesh.h
//
// What is proven of these meshes, and why: query/LABELS.md.
#pragma once

#include <isonest/labels.h>
#include <isonest/progress.h>

#include "query/surface_nets/net_plan.h"
#include "query/surface_nets/net_store.h"
#include "store/container/reader.h"

namespace isonest::detail {

/// What the traversal read.
struct NetCounts {
    std::uint64_t blocks = 0;
    std::uint64_t chunks_read = 0;
    std::uint64_t bytes_read = 0;
    std::uint64_t peak_cache_bytes = 0;
};

/// The cells in which a label whose nodes lie in [low, high] can have vertices: from the first to
/// the one before the second.
std::pair<Int3, Int3> cells_of_label(const Label& label);

/// Fills `net` with what the labels have, and seals it. `labels`: those of setting.wanted, and
/// where they are. Blocks that none of them reaches are left out. Throws Error{unsupported} for
/// values that are no labels, Error{corrupt, io, cancelled}. REQUIRES: the plan's cells hold those
/// of all labels.
NetCounts make_net(const StoreReader& store, const NetSetting& setting, const NetPlan& plan,
                   std::span<const Label> labels, NetStore& net, Progress& progress);

}  // namespace isonest::detail
