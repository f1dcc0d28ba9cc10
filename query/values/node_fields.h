// Indicators at the nodes of any level.
#pragma once

#include <isonest/field.h>

#include "store/base/box.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"

namespace isonest::detail {

/// Throws Error{invalid_argument} for values or a field of cells, and Error{not_found} for a field
/// that the store lacks.
void require_field_of_nodes(const StoreReader& store, Field field);

/// As fill_indicators(), for a box of nodes of a level: node p is node 2^level p of the finest
/// lattice.
void fill_indicators_at(ChunkCache& cache, Field field, int level, Box<double>& box);

}  // namespace isonest::detail
