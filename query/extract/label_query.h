// The part of a query that asks for a label in place of an isovalue.
#pragma once

#include "query/extract/extract_query.h"

namespace isonest::detail {

/// Sets the isovalue between the label and the others, and the part of the volume where it is.
/// REQUIRES: query.label; the rest of `asked` is made. Throws Error{invalid_argument} for what goes
/// with no label, and for one that the store's type of values does not hold.
void choose_label(const StoreReader& store, const SurfaceQuery& query, ExtractQuery& asked);

}  // namespace isonest::detail
