// The finest ranges of cubes of all ranks, at rank 0.
#pragma once

#include "preprocess/levels/centre_store.h"
#include "preprocess/ranks/pencils.h"
#include "store/container/format.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// Rank 0 gets those that the others' pencils made, and makes room for all levels. Collective.
/// Throws Error{io}.
void gather_cube_ranges(Communicator& ranks, const StoreLayout& layout, const Pencils& pencils,
                        CentreStore& centres);

}  // namespace isonest::detail
