// The ranks that share the traversals and simplifications of extractions, as rank 0 and each of the
// others see them.
#pragma once

#include <cstdint>

#include "store/ranks/communicator.h"

namespace isonest::detail {

/// What one rank did for the extractions so far.
struct RankWork {
    std::uint64_t traversals = 0;        ///< that were shared
    double traversal_seconds = 0;        ///< from the first brick of its own to the last
    double gathering_seconds = 0;        ///< in which its parts went to rank 0, or came from others
    std::uint64_t leaves = 0;            ///< as in the report, its own
    std::uint64_t chunks_read = 0;       ///< the same
    std::uint64_t bytes_read = 0;        ///< of the store
    std::uint64_t parts_bytes = 0;       ///< of the parts that it made
    std::uint64_t mappings = 0;          ///< meshes whose blocks were shared for simplification
    std::uint64_t mapped_blocks = 0;     ///< that it mapped, in all passes
    std::uint64_t mapped_triangles = 0;  ///< that these had before
    double mapping_seconds = 0;          ///< in which it mapped, rank 0 with what it did beside
    std::uint64_t meshes = 0;            ///< that were welded and written by all ranks
    std::uint64_t written_triangles = 0;  ///< of these, its own
    double welding_seconds = 0;           ///< in which they were welded and kept apart
    double writing_seconds = 0;           ///< in which its rows were written
};

/// Not thread-safe: of several extractions at once, one may use it.
struct RankTeam {
    Communicator& ranks;
    RankWork work = {};  ///< of this rank
};

}  // namespace isonest::detail
