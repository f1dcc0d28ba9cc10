// A mesh whose parts stay on the ranks that made them: welded, kept apart and written by all.
//
//     rank 0       weld ── apart ── begin(): the file, and what is around its rows ── rows ── name
//     other ranks  weld ── apart ─────────────────────────── rows and their places ── rows
#pragma once

#include <cstdint>
#include <optional>

#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/apart/keep_apart.h"
#include "query/mesh/measuring_sink.h"
#include "query/mesh/part_store.h"
#include "query/ranks/rank_team.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Whether all ranks can write what `sink` gets: it measures, and writes a file whose rows are at
/// known places (mesh_sections.h).
bool is_written_by_all(MeshSink& sink);

/// What rank 0 learns of the mesh.
struct MeshOnRanks {
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    ApartVertices apart;
};

/// On rank 0, while the others call help_with_mesh() with their parts of the same mesh: from
/// sealed parts to the file, whose bytes are those of one process with all parts. `apart`: how
/// vertices are kept apart, if they are; its box is not looked at. `layout`: of prepare().
/// REQUIRES: is_written_by_all(sink). Throws Error{io, cancelled} and what the sink throws.
MeshOnRanks mesh_on_ranks(RankTeam& team, PartStore& parts, std::optional<ApartRange> apart,
                          MeshLayout layout, MeshSink& sink, const ScratchFolder& folder,
                          Progress& progress);
void help_with_mesh(RankTeam& team, PartStore& parts, const ScratchFolder& folder,
                    Progress& progress);

}  // namespace isonest::detail
