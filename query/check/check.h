// Consistency tests of a store, chunk by chunk, from cheap to expensive.
#pragma once

#include <isonest/check.h>
#include <isonest/progress.h>

#include "store/container/reader.h"
#include "store/ranks/communicator.h"

namespace isonest::detail {

/// <isonest/check.h> for several ranks: each checks a share of the chunks with its own memory and
/// threads, rank 0 also the source. Collective: rank 0 gets the complete report, identical to that
/// of one process; the results of others are undefined. `ranks` is null for one process.
CheckReport check(const StoreReader& store, const CheckOptions& options, Progress& progress,
                  Communicator* ranks = nullptr);

}  // namespace isonest::detail
