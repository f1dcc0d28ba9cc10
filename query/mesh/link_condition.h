// Whether an edge of a surface can be collapsed without changing its topology.
//
// Source: T. Dey, H. Edelsbrunner, S. Guha, D. Nekhayev, "Topology preserving edge contraction"
// (1999): the condition on the links of the edge and its ends. A surface with borders is asked as
// the closed one that a further vertex makes of it, which is joined to all border edges.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <vector>

namespace isonest::detail {

/// What is opposite to a vertex in the triangles around it, in the direction of the triangles.
using LinkEdges = std::vector<std::array<std::uint64_t, 2>>;

/// The further vertex.
inline constexpr std::uint64_t kBeyondBorder = std::numeric_limits<std::uint64_t>::max();

/// Sorts the link of a vertex; if it is a path from border to border, closes it by two edges over
/// kBeyondBorder. False if it is not one ring then: the vertex is none of a manifold, or has two
/// triangles of the same corners.
bool close_link(LinkEdges& link);

/// Whether the edge between the vertices of two closed links can be collapsed. REQUIRES: there is
/// such an edge.
bool may_collapse(const LinkEdges& a, const LinkEdges& b);

}  // namespace isonest::detail
