// A piece of a surface that is simplified by itself.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "query/simplify/mapping/displacement.h"
#include "query/simplify/proof/point_triangle.h"

namespace isonest::detail {

using PatchTriangle = std::array<std::uint32_t, 3>;

/// The same triangle, its smallest corner first.
template <class T>
std::array<T, 3> from_smallest(const std::array<T, 3>& t) {
    const auto at = static_cast<std::size_t>(std::min_element(t.begin(), t.end()) - t.begin());
    return {t[at], t[(at + 1) % 3], t[(at + 2) % 3]};
}

/// Whether a triangle has to stay.
enum class Stay : std::uint8_t {
    no,
    now,     ///< in this pass
    forever  ///< and in all that follow
};

/// Where a surface is cut, or closed: borders and caps in its faces stay there. As vertices are:
/// world coordinates, float32.
struct PatchBox {
    static constexpr float kNowhere = std::numeric_limits<float>::quiet_NaN();
    std::array<float, 3> lo{kNowhere, kNowhere, kNowhere};
    std::array<float, 3> hi{kNowhere, kNowhere, kNowhere};
};

/// How far edges are collapsed.
struct CollapseLimits {
    double distance = 0;  ///< world units
    /// World units, squared: edges of which the quadrics estimate more are not collapsed.
    float square_estimate = 0;
};

inline constexpr std::uint32_t kNoServer = std::numeric_limits<std::uint32_t>::max();
inline constexpr std::uint32_t kSomeServers = kNoServer - 1;
/// Added to the number of a server that has others beside it.
inline constexpr std::uint32_t kWithOthers = std::uint32_t{1} << 31U;

/// `furthest`: of which the quadrics may estimate, in distances.
inline CollapseLimits limits_of(double distance, double furthest) {
    const double estimate = furthest * distance;
    return {distance, static_cast<float>(estimate * estimate)};
}

inline constexpr std::uint32_t kNoVertex = std::numeric_limits<std::uint32_t>::max();

inline Triangle triangle_at(std::span<const std::array<float, 3>> positions,
                            const PatchTriangle& t) {
    return {point_at(positions[t[0]]), point_at(positions[t[1]]), point_at(positions[t[2]])};
}

/// Vertices are places in `positions`; all triangles are oriented alike.
struct Patch {
    std::vector<std::array<float, 3>> positions;  ///< world coordinates
    /// Of each vertex one of the full surface that is near: that itself, or where one was moved
    /// from. kNoVertex: it is not in the patch.
    std::vector<std::uint32_t> near;
    PatchBox box;
    /// Vertices that triangles outside of the patch have, too: they and the edges between them
    /// stay.
    std::vector<bool> shared;
    std::vector<PatchTriangle> triangles;
    std::vector<Stay> stay;  ///< of each triangle
    /// Of each triangle: whether the edges of its corners have all been tried within this limit.
    std::vector<bool> tried;
    /// Of each triangle: how far it is from the full surface.
    std::vector<Displacement> displacements;
    std::vector<PatchTriangle> fine;  ///< the full surface near the patch
    /// Of each fine triangle: the one that alone is within the limit of all its points; with
    /// kWithOthers, one of several that are so together; kSomeServers: none of these is known.
    /// kNoServer: it may be as far as it likes, and is there for others to be near to.
    std::vector<std::uint32_t> servers;
    /// The triangles are the fine ones, each of which serves itself.
    bool is_full = false;

    [[nodiscard]] Double3 point(std::uint32_t v) const { return point_at(positions[v]); }
    [[nodiscard]] Triangle at(const PatchTriangle& t) const { return triangle_at(positions, t); }
};

}  // namespace isonest::detail
