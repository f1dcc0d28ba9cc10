// Fewer triangles for a patch, each with how far the full surface is from it at most.
//
// Edges are collapsed one after the other, those by which the surface changes least first, as long
// as no triangle is further than a distance from what it stands for
// (query/simplify/mapping/fan_overlay.h). All that is known of the full surface is the displacement
// of each triangle: why that is enough is in query/DISTANCE.md, "By successive mappings".
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <vector>

#include "query/simplify/mapping/displacement.h"
#include "query/simplify/patch.h"

namespace isonest::detail {

/// Vertices are places in `positions`; all triangles are oriented alike.
struct MappedPatch {
    std::vector<std::array<float, 3>> positions;  ///< world coordinates
    PatchBox box;
    /// Vertices that triangles outside of the patch have, too: they and the edges between them
    /// stay.
    std::vector<bool> shared;
    std::vector<PatchTriangle> triangles;
    std::vector<Displacement> displacements;  ///< of each triangle
    /// Of each triangle: whether the edges of its corners have all been tried within this limit.
    std::vector<bool> tried;
};

struct MappingLimits {
    double distance = 0;  ///< world units: no displacement becomes larger
    /// World units, squared: edges of which the quadrics estimate more are not collapsed.
    float square_estimate = 0;
};

/// Where collapses stood in their order, in bins: by the largest estimate (world units, squared)
/// until then, in powers of two to a sixteenth.
inline std::size_t bin_of(float square_error) {
    constexpr float kLeast = 1e-30F;
    return std::bit_cast<std::uint32_t>(square_error + kLeast) >> 19U;
}
/// No estimate in the bin is larger.
inline float end_of_bin(std::size_t bin) {
    return std::bit_cast<float>(static_cast<std::uint32_t>((bin + 1) << 19U) - 1);
}

struct MappingResult {
    std::vector<std::uint64_t> gone_at;  ///< triangles, by bin
};

/// Heap per triangle of a patch, at most, that map_patch() takes beside the patch.
inline constexpr std::size_t kMapBytesPerTriangle = 400;

/// Takes triangles out of `patch`; those that stay keep their order, and vertices that no triangle
/// has any more stay in `positions`. Displacements that are larger than the limit before stay as
/// they are. The topology stays. No edge becomes folded more than before by more than 72 degrees.
/// Thread-safe.
MappingResult map_patch(MappedPatch& patch, const MappingLimits& limits);

}  // namespace isonest::detail
