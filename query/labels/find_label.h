// Where one label of a store is.
#pragma once

#include <optional>

#include <isonest/labels.h>

#include "store/container/reader.h"

namespace isonest::detail {

/// The label `id`, whose value is `value`, and its nodes; nothing if there are none. Reads the
/// chunks that can have it, one for each thread at a time. Throws Error{corrupt, io, cancelled}.
std::optional<Label> find_label(const StoreReader& store, std::int64_t id, double value,
                                int threads, Progress& progress);

}  // namespace isonest::detail
