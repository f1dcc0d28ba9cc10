// Contour lines of the values at a mesh's vertices.
#pragma once

#include <span>

#include "query/mesh/part_store.h"
#include "query/mesh/weld.h"
#include "query/traverse/traversal.h"

namespace isonest::detail {

/// Maximum number of values per query.
inline constexpr std::size_t kMaxContours = 1000;

/// Marches all triangles of a welded mesh for each of `values` and passes the lines on as parts of
/// "triangles" whose last two corners are equal, as LocalMesh::march_line makes them. Their
/// positions are world coordinates, and their only attribute is the contour's value. Once welded,
/// the parts do not depend on how the mesh was divided into parts. `attributes`: of the vertices;
/// their value is contoured. At most `part_vertices` + 2 vertices per value are held at a time.
/// REQUIRES: attributes.value, and the lines have only their value, of the same width;
/// values.size() <= kMaxContours. Throws Error{limit} beyond 2^48 vertices, what the sink throws,
/// and Error{cancelled}.
void contour_lines(const PartStore& parts, const VertexNumbers& weld,
                   std::span<const double> values, const AttributeChoice& attributes,
                   std::size_t part_vertices, const PartSink& sink, Progress& progress);

/// Maximum rounding error of the lines' values.
double contour_rounding(std::span<const double> values, const AttributeChoice& attributes);

}  // namespace isonest::detail
