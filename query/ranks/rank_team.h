// The ranks that share the traversals of extractions, as rank 0 and each of the others see them.
#pragma once

#include <cstdint>

#include "store/ranks/communicator.h"

namespace isonest::detail {

/// What one rank did for the extractions so far.
struct RankWork {
    std::uint64_t traversals = 0;   ///< that were shared
    double traversal_seconds = 0;   ///< from the first brick of its own to the last
    double gathering_seconds = 0;   ///< in which its parts went to rank 0, or came from others
    std::uint64_t leaves = 0;       ///< as in the report, its own
    std::uint64_t chunks_read = 0;  ///< the same
    std::uint64_t bytes_read = 0;   ///< of the store
    std::uint64_t parts_bytes = 0;  ///< of the parts that it made
};

/// Not thread-safe: of several extractions at once, one may use it.
struct RankTeam {
    Communicator& ranks;
    RankWork work = {};  ///< of this rank
};

}  // namespace isonest::detail
