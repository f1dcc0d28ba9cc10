// From the triangles that one thread has collected to a part that can be welded to others.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "query/march/clip.h"
#include "query/march/mesh_part.h"
#include "query/march/part_vertices.h"

namespace isonest::detail {

struct CollectedTriangle {
    std::array<std::uint32_t, 3> v;
    bool cut;  ///< it may reach out of the box
};

/// The part inside the box. `lines`: the "triangles" are lines, their last two corners equal.
/// Flattens the vertices, and puts the numbers that hold into the triangles.
MeshPart finish_part(PartVertices& vertices, std::vector<CollectedTriangle>& triangles, bool lines,
                     const ClipBox& box);

}  // namespace isonest::detail
