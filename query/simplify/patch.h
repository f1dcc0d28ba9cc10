// A piece of a surface that is simplified on its own.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <span>
#include <vector>

#include <isonest/int3.h>

#include "query/mesh/vertex_stars.h"
#include "query/simplify/proof/point_triangle.h"

namespace isonest::detail {

// How far points of a surface may have been moved to become points of a triangle.

/// A box that contains m - s for each pair of related points (s on the full surface, m on the
/// triangle), up to a vector of length `radius`. World units.
struct Displacement {
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    float radius = 0;  ///< the part that was measured as a distance

    /// Maximum distance between related points.
    [[nodiscard]] double bound() const {
        double sum = 0;
        for (std::size_t a = 0; a < 3; ++a) {
            const double far = std::max(-static_cast<double>(lo[a]), static_cast<double>(hi[a]));
            sum += far * far;
        }
        constexpr double kRounding = 1e-14;
        return (std::sqrt(sum) + static_cast<double>(radius)) * (1 + kRounding);
    }
    bool operator==(const Displacement&) const = default;
};

/// A float that is not smaller (not larger) than x.
inline float float_above(double x) {
    const auto f = static_cast<float>(x);
    return static_cast<double>(f) < x ? std::nextafterf(f, std::numeric_limits<float>::infinity())
                                      : f;
}
inline float float_below(double x) {
    return -float_above(-x);
}

/// The displacement after the triangle's points have been moved by parts of `by`, each by a
/// different part.
inline Displacement moved_up_to(Displacement d, const Double3& by) {
    for (std::size_t a = 0; a < 3; ++a) {
        d.lo[a] = float_below(static_cast<double>(d.lo[a]) + std::min(by[a], 0.0));
        d.hi[a] = float_above(static_cast<double>(d.hi[a]) + std::max(by[a], 0.0));
    }
    return d;
}

using PatchTriangle = std::array<std::uint32_t, 3>;

/// The same triangle, with its smallest corner first.
template <class T>
std::array<T, 3> from_smallest(const std::array<T, 3>& t) {
    const auto at = static_cast<std::size_t>(std::min_element(t.begin(), t.end()) - t.begin());
    return {t[at], t[(at + 1) % 3], t[(at + 2) % 3]};
}

/// Whether a triangle must be kept.
enum class Stay : std::uint8_t {
    no,
    now,     ///< kept in this pass
    forever  ///< kept in this and all following passes
};

/// Where a surface is cut or closed: borders and caps in the faces of the box stay there.
using PatchBox = BoxFaces;

/// Limits for the collapse of edges.
struct CollapseLimits {
    double distance = 0;  ///< world units
    /// World units, squared: edges with a larger quadric estimate are not collapsed.
    float square_estimate = 0;
};

inline constexpr std::uint32_t kNoWitness = std::numeric_limits<std::uint32_t>::max();
inline constexpr std::uint32_t kSomeWitnesses = kNoWitness - 1;
/// Added to the number of a witness that is one of several.
inline constexpr std::uint32_t kWithOthers = std::uint32_t{1} << 31U;

/// `furthest`: largest quadric estimate, as a multiple of the distance.
inline CollapseLimits limits_of(double distance, double furthest) {
    const double estimate = furthest * distance;
    return {distance, static_cast<float>(estimate * estimate)};
}

inline constexpr std::uint32_t kNoVertex = std::numeric_limits<std::uint32_t>::max();

inline Triangle triangle_at(std::span<const std::array<float, 3>> positions,
                            const PatchTriangle& t) {
    return {point_at(positions[t[0]]), point_at(positions[t[1]]), point_at(positions[t[2]])};
}

/// Vertices are indices into `positions`; all triangles have the same orientation.
struct Patch {
    std::vector<std::array<float, 3>> positions;  ///< world coordinates
    /// For each vertex, a nearby vertex of the full surface: itself, or the one from which it was
    /// moved. kNoVertex: it is not in the patch.
    std::vector<std::uint32_t> near;
    PatchBox box;
    /// Vertices that are also used by triangles outside the patch; they and the edges between them
    /// are kept.
    std::vector<bool> shared;
    std::vector<PatchTriangle> triangles;
    std::vector<Stay> stay;  ///< of each triangle
    /// For each triangle: whether all edges at its corners have been tried within this limit.
    std::vector<bool> tried;
    /// For each triangle: its distance from the full surface.
    std::vector<Displacement> displacements;
    std::vector<PatchTriangle> fine;  ///< the full surface near the patch
    /// For each fine triangle: the triangle that alone is within the limit of all its points; with
    /// kWithOthers, one of several that are so together; kSomeWitnesses: these are not known.
    /// kNoWitness: its distance is not limited; it only serves as a target for others.
    std::vector<std::uint32_t> witnesses;
    /// The triangles are the fine triangles, each is its own witness.
    bool is_full = false;

    /// Starts with the fine triangles: they become the triangles, and each is its own witness.
    void set_full() {
        is_full = true;
        triangles = fine;
        stay.resize(fine.size());
        tried.resize(fine.size());
        displacements.resize(fine.size());
        witnesses.resize(fine.size());
        std::iota(witnesses.begin(), witnesses.end(), 0U);
    }
    [[nodiscard]] Double3 point(std::uint32_t v) const { return point_at(positions[v]); }
    [[nodiscard]] Triangle at(const PatchTriangle& t) const { return triangle_at(positions, t); }
};

}  // namespace isonest::detail
