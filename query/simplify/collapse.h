// Proposes a patch with fewer triangles, without any promise of its own.
#pragma once

#include <span>
#include <vector>

#include "query/simplify/patch.h"

namespace isonest::detail {

/// Collapses edges of `triangles` by their quadric errors as long as those are estimated to stay
/// below `error` (world units). `locked` vertices stay, and with them all edges between two of
/// them that have a triangle on one side. Source: M. Garland, P. Heckbert, "Surface simplification
/// using quadric error metrics", SIGGRAPH 1997, as the library meshoptimizer does it.
std::vector<PatchTriangle> collapse_edges(const Patch& patch,
                                          std::span<const PatchTriangle> triangles,
                                          const std::vector<bool>& locked, double error);

}  // namespace isonest::detail
