// Fewer triangles for a patch, each with how far the full surface is from it at most.
//
// Edges are collapsed one after the other, those by which the surface changes least first, as long
// as no triangle is further than a distance from what it stands for
// (query/simplify/mapping/fan_overlay.h). All that is known of the full surface is the displacement
// of each triangle: why that is enough is in query/DISTANCE.md, "By successive mappings".
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "query/simplify/collapse/collapse_stars.h"
#include "query/simplify/mapping/displacement.h"
#include "query/simplify/patch.h"
#include "query/simplify/sheets/nodes_passed.h"

namespace isonest::detail {

/// Vertices are places in `positions`; all triangles are oriented alike.
struct MappedPatch {
    std::vector<std::array<float, 3>> positions;  ///< world coordinates
    PatchBox box;
    /// Vertices that triangles outside of the patch have, too: they and the edges between them
    /// stay.
    std::vector<bool> shared;
    /// Of each vertex the next one that stands for the same in another sheet, in rings (SheetLines,
    /// query/simplify/sheets); empty: no sheets meet.
    std::vector<std::uint32_t> next_copy;
    /// The nodes that the surface must not pass over; none if nothing is said.
    std::optional<KeptNodes> kept_nodes;
    std::vector<PatchTriangle> triangles;
    std::vector<Displacement> displacements;  ///< of each triangle
    /// Of each triangle: whether the edges of its corners have all been tried within this limit.
    std::vector<bool> tried;
};

/// Heap per triangle of a patch, at most, that map_patch() takes beside the patch.
inline constexpr std::size_t kMapBytesPerTriangle = 400;

/// Takes triangles out of `patch`; those that stay keep their order, and vertices that no triangle
/// has any more stay in `positions`. Displacements that are larger than the limit before stay as
/// they are. The topology stays; where sheets meet, a vertex goes in all of them. No edge becomes
/// folded more than before by more than 72 degrees.
/// Thread-safe.
GoneTriangles map_patch(MappedPatch& patch, const CollapseLimits& limits);

}  // namespace isonest::detail
