// What stands behind HDF5's end of a store against HDF5's structures and the chunk table.
#pragma once

#include "query/check/findings.h"
#include "store/container/reader.h"

namespace isonest::detail {

/// Adds what it finds to `findings`, as test "footer". Throws Error{io}.
void check_footer(const StoreReader& store, Findings& findings);

}  // namespace isonest::detail
