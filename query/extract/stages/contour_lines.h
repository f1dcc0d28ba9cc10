// Contour lines of the values that a mesh carries at its vertices.
#pragma once

#include <span>

#include "query/mesh/part_store.h"
#include "query/mesh/weld.h"
#include "query/traverse/traversal.h"

namespace isonest::detail {

/// How many values may be asked for at once.
inline constexpr std::size_t kMostContours = 1000;

/// Marches all triangles of a welded mesh for each of `values` and hands the lines on as parts of
/// "triangles" whose last two corners are equal, as LocalMesh::march_line makes them. Their
/// positions are world coordinates, their one attribute is the contour's value, and the parts do
/// not depend on how the mesh was cut into parts, once they are welded. `attributes`: what
/// the vertices carry; their value is contoured. REQUIRES: attributes.value, and what the lines
/// carry is their value alone, as wide. Vertices held at a time: at most `part_vertices` + 2 per
/// value. REQUIRES: values.size() <= kMostContours. Throws Error{limit} beyond 2^48 vertices, what
/// the sink throws, and Error{cancelled}.
void contour_lines(const PartStore& parts, const VertexNumbers& weld,
                   std::span<const double> values, const AttributeChoice& attributes,
                   std::size_t part_vertices, const PartSink& sink, Progress& progress);

/// Most by which the lines' values are rounded.
double contour_rounding(std::span<const double> values, const AttributeChoice& attributes);

}  // namespace isonest::detail
