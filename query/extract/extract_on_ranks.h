// Extractions whose traversals several ranks share.
//
//     rank 0       extract() as ever ── a traversal begins ──▶ its own share ─▶ parts of all ─▶
//     weld, stages, sink
//                                          │ job                                   ▲ parts
//     other ranks  wait for a job ◀────────┘──▶ their shares ────────────────────────┘
//
// Rank 0 alone has the query, the stages and the sink. A mesh that needs no stage and whose sink is
// a file of rows at known places is welded and written by all ranks (query/ranks/mesh_on_ranks.h):
// then parts stay where they were made, and the mesh is another kind of job. Of the stages,
// simplification by successive mappings is shared (query/ranks/rank_mapping.h): its blocks are one
// more kind of job. All else that does not go through find_parts() is made by rank 0 alone, while
// the others wait; so is what is_shared() rules out.
#pragma once

#include <cstddef>
#include <functional>
#include <span>

#include <isonest/extract.h>

#include "query/extract/extract_query.h"
#include "query/ranks/rank_team.h"

namespace isonest::detail {

/// Calls `work` on rank 0 with `options` whose team are all ranks: what it extracts from `store`,
/// each time it calls an extraction, the ranks share. `values`: the store of vertex values, or
/// null. Memory and threads of `options` are those of each rank. Returns what this rank did. Meshes
/// and files are those of one process, byte for byte. Collective. Throws what `work` throws,
/// Error{invalid_argument} if a rank sees another store, Error{io, limit, corrupt} of any rank, and
/// on the other ranks Error{cancelled} then.
RankWork extract_on_ranks(Communicator& ranks, const Store& store, const Store* values,
                          const std::function<void(const ExtractOptions&)>& work,
                          const ExtractOptions& options, Progress& progress);

/// Whether ranks share the traversal: surfaces of values or of a label, slices and contours of
/// volumes. Not: data in a plane, and surfaces whose elements stop at a distance (every rank would
/// need the distances of all).
bool is_shared(const ExtractQuery& asked);

/// Tells the other ranks that a traversal begins. REQUIRES: is_shared(asked); this is rank 0, and
/// find_parts() with the same team follows.
void begin_shared_traversal(RankTeam& team, const StoreReader& store, const ExtractQuery& asked,
                            std::span<const double> isovalues);

/// Tells the other ranks that the mesh of isovalue number `i` of the last traversal is to be made
/// of the parts that they have. REQUIRES: this is rank 0, and mesh_on_ranks() follows.
void begin_shared_mesh(RankTeam& team, std::size_t i);

}  // namespace isonest::detail
