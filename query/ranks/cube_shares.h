// Which rank traverses which part.
//
// The finest cells in Morton order are divided into ranges with about the same number of cubes of
// 8^3 cells where the chunk table and the stored ranges allow surface. They are counted in groups,
// each by one rank, so no rank reads all of the tables, and the number of counts does not grow with
// the volume.
#pragma once

#include <cstdint>
#include <span>

#include "query/traverse/traversal.h"
#include "store/container/chunk_source.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

// The ranks that share the traversals and simplifications of extractions, as seen by rank 0 and by
// the others.

/// The work of one rank for the extractions so far.
struct RankWork {
    std::uint64_t traversals = 0;   ///< number of shared traversals
    double traversal_seconds = 0;   ///< from its first brick to its last
    double gathering_seconds = 0;   ///< sending its parts to rank 0, or receiving those of others
    std::uint64_t leaves = 0;       ///< as in the report, of this rank
    std::uint64_t chunks_read = 0;  ///< likewise
    std::uint64_t bytes_read = 0;   ///< of the store
    std::uint64_t parts_bytes = 0;  ///< size of the parts that it made
    std::uint64_t mappings = 0;  ///< number of meshes whose blocks were shared for simplification
    std::uint64_t mapped_blocks = 0;     ///< blocks that it mapped, in all passes
    std::uint64_t mapped_triangles = 0;  ///< their triangles before
    double mapping_seconds = 0;          ///< mapping; for rank 0 including its other work meanwhile
    std::uint64_t meshes = 0;            ///< number of meshes welded and written by all ranks
    std::uint64_t written_triangles = 0;  ///< those that it wrote
    double welding_seconds = 0;           ///< welding and separating vertices
    double writing_seconds = 0;           ///< writing its rows
};

/// Not thread-safe: only one of several concurrent extractions may use it.
struct RankTeam {
    Communicator& ranks;
    RankWork work = {};  ///< of this rank
};

/// This rank's share of the surfaces in `box` or, if there is one, of the slice in `plane`. Every
/// cell belongs to exactly one rank. Collective. Throws Error{cancelled}, and what the source
/// throws except for damage, which is reported when the chunk is needed.
CubeShare share_of(Communicator& ranks, const ChunkSource& source, const ClipBox& box,
                   const std::optional<LatticePlane>& plane, std::span<const double> isovalues);

}  // namespace isonest::detail
