// Simplifies a patch so that it and the full surface are within a distance of each other.
//
// Edges are collapsed one after another (query/simplify/collapse/star_collapse.h). Each collapse is
// measured first: everything that was near the triangles around the edge must be near the triangles
// that replace them (query/simplify/proof/witness_lists.h), and these must be near the full
// surface. The latter follows from their projection onto the previous triangles
// (query/simplify/collapse/star_mapping.h), or is measured (query/simplify/proof/projected_cover.h,
// query/simplify/proof/witness_lists.h). For a full surface, collapses that mappings alone prove
// come first. So the errors that determine the order of collapses do not affect the bound. An edge
// that cannot be collapsed into its end is tried once more with that end at the position of the
// smallest quadric error, measured in the same way (query/simplify/collapse/star_collapse.h).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "query/simplify/patch.h"

namespace isonest::detail {

struct SimplifiedPatch {
    /// A vertex that was moved from its position in the patch.
    struct Moved {
        std::uint32_t vertex = 0;
        std::array<float, 3> to{};
    };

    std::vector<PatchTriangle> triangles;
    std::vector<Moved> moved;  ///< vertices of the triangles that were moved; ascending
    std::vector<Displacement> displacements;  ///< of each triangle
    std::vector<bool> kept;                   ///< triangles that stay forever
    std::vector<bool> tried;                  ///< as in the patch, for the next pass
    /// For each fine triangle, the triangles near it: indices into `triangles`. Empty for one
    /// without witnesses in the patch.
    std::vector<std::uint32_t> first_witness;  ///< one more than there are fine triangles
    std::vector<std::uint32_t> witnesses;
    double largest = 0;  ///< largest distance that occurred; at most the limit

    [[nodiscard]] std::span<const std::uint32_t> witnesses_of(std::size_t fine) const {
        return std::span(witnesses).subspan(first_witness[fine],
                                            first_witness[fine + 1] - first_witness[fine]);
    }
};

/// Maximum heap per triangle and per fine triangle of a patch during simplify_patch(), not
/// including the patch.
inline constexpr std::size_t kSimplifyBytesPerTriangle = 600;

/// The limits of a distance (world units, > 0).
CollapseLimits simplify_limits(double distance);

/// No edge is folded more than before by more than 120 degrees; the topology is preserved.
/// REQUIRES: fine triangles with witnesses are within the limit of these, and these are within the
/// limit of the fine triangles according to their displacements. Thread-safe.
SimplifiedPatch simplify_patch(const Patch& patch, const CollapseLimits& limits);

}  // namespace isonest::detail
