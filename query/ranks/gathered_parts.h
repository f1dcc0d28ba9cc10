// Finished parts of a mesh: from all ranks to rank 0, or where they are.
#pragma once

#include <cstdint>
#include <functional>

#include "query/mesh/part_store.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

struct SettledParts {
    std::uint64_t bytes = 0;  ///< of the parts that this rank has made
    bool stay = false;        ///< where they are
};

/// Seals `parts`. `may_stay`: of rank 0, called when its totals are those of all ranks; says
/// whether all parts stay where they are, if it is there at all. Else those of the other ranks are
/// in rank 0's afterwards, and theirs have none any more. The stores were made alike. Collective.
/// Throws Error{io, cancelled}.
SettledParts settle_parts(Communicator& ranks, PartStore& parts,
                          const std::function<bool()>& may_stay);

}  // namespace isonest::detail
