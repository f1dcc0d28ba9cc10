// A mesh whose parts stay on the ranks that made them: welded, separated and written by all.
//
//     rank 0       weld ── apart ── begin(): the file, and what is around its rows ── rows ── name
//     other ranks  weld ── apart ─────────────────────────── rows and their places ── rows
#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/apart/keep_apart.h"
#include "query/mesh/measuring_sink.h"
#include "query/mesh/part_store.h"
#include "query/ranks/cube_shares.h"
#include "store/files/scratch_file.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

// Finished parts of a mesh: sent from all ranks to rank 0, or kept where they are.

struct SettledParts {
    std::uint64_t bytes = 0;  ///< size of the parts that this rank has made
    bool stay = false;        ///< whether the parts stay where they are
};

/// Seals `parts`. `may_stay`: on rank 0, called when its totals are those of all ranks; returns
/// whether all parts stay where they are. If it is empty or returns false, the parts of the other
/// ranks are moved to rank 0. All stores must have been created with the same arguments.
/// Collective. Throws Error{io, cancelled}.
SettledParts settle_parts(Communicator& ranks, PartStore& parts,
                          const std::function<bool()>& may_stay);

/// Whether all ranks can write the output of `sink`: it measures, and writes a file whose rows are
/// at known places (mesh_files.h).
bool is_written_by_all(MeshSink& sink);

/// Properties of the mesh, on rank 0.
struct MeshOnRanks {
    std::uint64_t vertices = 0;
    std::uint64_t triangles = 0;
    ApartVertices apart;
};

/// Call on rank 0, while the others call help_with_mesh() with their parts of the same mesh.
/// Produces from sealed parts a file that is identical to that of one process with all parts.
/// `apart`: how vertices are separated, if they are; its box is ignored. `layout`: that of
/// prepare(). REQUIRES: is_written_by_all(sink). Throws Error{io, cancelled} and what the sink
/// throws.
MeshOnRanks mesh_on_ranks(RankTeam& team, PartStore& parts, std::optional<ApartRange> apart,
                          MeshLayout layout, MeshSink& sink, const ScratchFolder& folder,
                          Progress& progress);
void help_with_mesh(RankTeam& team, PartStore& parts, const ScratchFolder& folder,
                    Progress& progress);

}  // namespace isonest::detail
