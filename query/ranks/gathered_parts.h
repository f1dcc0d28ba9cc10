// Finished parts of a mesh, from all ranks to rank 0.
#pragma once

#include "query/mesh/part_store.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Seals `parts`. Those of the other ranks are in rank 0's afterwards, and theirs have none any
/// more. The stores were made alike. Returns the bytes of the parts that this rank had. Collective.
/// Throws Error{io, cancelled}.
std::uint64_t gather_parts(Communicator& ranks, PartStore& parts);

}  // namespace isonest::detail
