// Proposes a patch with fewer triangles, of the same topology, but without any promise about
// distances.
//
// Sources: M. Garland, P. Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH
// 1997, for the order of the collapses; T. Dey, H. Edelsbrunner, S. Guha, D. Nekhayev, "Topology
// preserving edge contraction" (1999), for those that are allowed. Libraries that collapse edges in
// memory (meshoptimizer among them) do not ask the latter; what had to stay of their proposals was
// 1.5 to 2 times as much.
#pragma once

#include <span>
#include <vector>

#include "query/simplify/patch.h"

namespace isonest::detail {

/// Collapses edges of `triangles` into one of their ends, as long as the quadric error stays below
/// `error` (world units), the cheapest first. `locked` vertices stay, and no edge arises between
/// two of them. Border vertices move along the border. REQUIRES: the link of each vertex that is
/// not locked is a ring or a path. Deterministic; thread-safe.
std::vector<PatchTriangle> collapse_edges(const Patch& patch,
                                          std::span<const PatchTriangle> triangles,
                                          const std::vector<bool>& locked, double error);

}  // namespace isonest::detail
