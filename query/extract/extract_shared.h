// Extractions that share a traversal: of several isovalues, or by several ranks.
#pragma once

#include <cstddef>
#include <functional>
#include <span>

#include <isonest/extract.h>

#include "query/extract/extract_query.h"
#include "query/ranks/cube_shares.h"

namespace isonest::detail {

// Extractions whose traversals are shared by several ranks.
//
//     rank 0       extract() ── traversal ──▶ own share ─▶ parts of all ─▶ weld, stages, sink
//                                   │ job                     ▲ parts
//     other ranks  wait for a job ◀─┘──▶ their shares ────────┘
//
// Only rank 0 has the query, the stages and the sink. A mesh that needs no stage and whose sink is
// a file of rows at known places is welded and written by all ranks (query/ranks/mesh_on_ranks.h):
// parts then stay where they were made, and the mesh is another kind of job. Of the stages,
// simplification by successive mappings is shared (query/ranks/rank_mapping.h): its blocks are a
// further kind of job. Everything else that does not use PartsTraversal is done by rank 0 alone,
// while the others wait; so is what ExtractQuery::is_shared() excludes.

/// Calls `work` on rank 0 with `options` whose team is all ranks: whenever it runs an extraction
/// from `store`, the ranks share it. `values`: the store of vertex values, or null. Memory and
/// threads of `options` are those of each rank. Returns the work of this rank. Meshes and files are
/// byte for byte those of one process. Collective. Throws what `work` throws,
/// Error{invalid_argument} if a rank sees another store, Error{io, limit, corrupt} of any rank, and
/// in these cases Error{cancelled} on the other ranks.
RankWork extract_on_ranks(Communicator& ranks, const Store& store, const Store* values,
                          const std::function<void(const ExtractOptions&)>& work,
                          const ExtractOptions& options, Progress& progress);

/// Announces a traversal to the other ranks. REQUIRES: asked.is_shared(); this is rank 0,
/// and PartsTraversal::find() with the same team follows.
void begin_shared_traversal(RankTeam& team, const StoreReader& store, const ExtractQuery& asked,
                            std::span<const double> isovalues);

/// Announces to the other ranks that the mesh of isovalue number `i` of the last traversal is to be
/// made from the parts that they have. REQUIRES: this is rank 0, and mesh_on_ranks() follows.
void begin_shared_mesh(RankTeam& team, std::size_t i);

}  // namespace isonest::detail
