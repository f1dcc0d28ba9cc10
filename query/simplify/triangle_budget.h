// The smallest distance at which a mesh has few enough triangles.
#pragma once

#include <cstdint>

#include "query/simplify/simplify_mesh.h"

namespace isonest::detail {

/// Looks for the smallest limit, from about `first` up to `most` (world units), at which the mesh
/// has at most `triangles`, and stops when it has nearly as many. Counts do not always fall with
/// the limit: it is the smallest of those that were tried. The same result for any number of
/// threads. With more triangles than asked for: the mesh within `most`. Throws what
/// the simplifier throws.
Simplified within_budget(MeshSimplifier& simplifier, std::uint64_t triangles, double first,
                         double most);

}  // namespace isonest::detail
