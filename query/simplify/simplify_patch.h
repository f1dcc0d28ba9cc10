// Fewer triangles for a patch, none of them and nothing of the full surface further from the other
// than a distance.
//
// Edges are collapsed one after the other (query/simplify/collapse/collapse_stars.h), each only
// after it was measured: all that the triangles around it were near to is near to those that
// replace them (query/simplify/proof/server_lists.h), and these are near to the full surface: by
// how they project onto the triangles before (query/simplify/mapping/star_mapping.h), or measured
// (query/simplify/proof/projected_cover.h, query/simplify/proof/server_lists.h). Of a full surface,
// what mappings alone prove is collapsed before all else. So the errors
// by which the collapses are ordered play no part in the bound. An edge that cannot be collapsed
// into its end is tried once more with that end at the place of the smallest quadric error,
// measured in the same way (query/simplify/collapse/placed_collapse.h).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "query/simplify/patch.h"

namespace isonest::detail {

struct SimplifiedPatch {
    /// A vertex that is at another place than in the patch.
    struct Moved {
        std::uint32_t vertex = 0;
        std::array<float, 3> to{};
    };

    std::vector<PatchTriangle> triangles;
    std::vector<Moved> moved;  ///< of the vertices of the triangles; in ascending order
    std::vector<Displacement> displacements;  ///< of each of them
    std::vector<bool> kept;                   ///< those that stay forever
    std::vector<bool> tried;                  ///< as in the patch, for the pass that comes
    /// Of each fine triangle those that it is near to: places in `triangles`. None of one
    /// that has none in the patch.
    std::vector<std::uint32_t> first_server;  ///< one more than there are fine triangles
    std::vector<std::uint32_t> servers;
    double largest = 0;  ///< distance that was met; at most the limit

    [[nodiscard]] std::span<const std::uint32_t> servers_of(std::size_t fine) const {
        return std::span(servers).subspan(first_server[fine],
                                          first_server[fine + 1] - first_server[fine]);
    }
};

/// Heap per triangle and per fine triangle of a patch, at most, that simplify_patch() takes beside
/// the patch.
inline constexpr std::size_t kSimplifyBytesPerTriangle = 600;

/// The limits of a distance (world units, > 0).
CollapseLimits simplify_limits(double distance);

/// No edge becomes folded more than before by more than 120 degrees; the topology stays. REQUIRES:
/// the fine triangles that have servers are within the limit of these, and those of the fine ones
/// by their displacements. Thread-safe.
SimplifiedPatch simplify_patch(const Patch& patch, const CollapseLimits& limits);

}  // namespace isonest::detail
