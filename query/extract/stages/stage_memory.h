// How many threads of a stage the memory holds.
#pragma once

#include <algorithm>
#include <cstdint>

#include <isonest/extract.h>

#include "query/extract/stages/staged_volume.h"
#include "store/base/memory_budget.h"
#include "store/base/workers.h"

namespace isonest::detail {

/// `each`: heap of one thread. Throws Error{limit} if the memory holds none; `what` needs it.
inline int threads_within(const StagedVolume& volume, const ExtractOptions& options,
                          std::uint64_t each, const char* what) {
    require_memory(volume.name, options.memory, kLibraryHeap + each, what);
    return static_cast<int>(
        std::min((options.memory - kLibraryHeap) / each,
                 static_cast<std::uint64_t>(Workers::count_of(options.threads))));
}

}  // namespace isonest::detail
