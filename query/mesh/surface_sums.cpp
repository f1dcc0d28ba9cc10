// The volume within a closed surface is a sum over its triangles: C. Zhang and T. Chen, "Efficient
// feature extraction for 2D/3D objects in mesh representation", ICIP 2001.
//
// Sums are whole numbers of a power of two, 2^-61 or less of the box's diagonal squared or cubed,
// so that the order of the triangles does not matter. 2^64 triangles do not overflow them.
//
// The mesh is closed if every edge is passed as often in one direction as in the other. Vertex v
// has a number m(v), mixed from v. An edge from a to b adds m(a) m(b) modulo 2^64 if a < b, and
// takes it away if a > b, so that the sum of a closed mesh is 0. Of a mesh with a border it is a
// polynomial, linear in each m(v) and not 0: of the 2^64 values of one m(v) at most 2^k make it 0,
// where 2^k divides the factor of that m(v), which is itself a sum of such numbers. Were they
// random, the sum would be 0 with a probability below 2^-50.
#include "query/mesh/surface_sums.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "query/mesh/border_count.h"
#include "store/base/vector3.h"

namespace isonest::detail {
namespace {

/// Of the box's diagonal, squared or cubed; a double has no more than 53.
constexpr int kBits = 61;

Double3 less(const std::array<float, 3>& to, const Double3& from) {
    Double3 d{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        d[axis] = static_cast<double>(to[axis]) - from[axis];
    }
    return d;
}

/// What the edge between two vertices with these mixed numbers adds.
std::uint64_t of_edge(std::uint64_t a, std::uint64_t b, std::uint64_t mixed_a,
                      std::uint64_t mixed_b) {
    const std::uint64_t sign =
        static_cast<std::uint64_t>(a < b) - static_cast<std::uint64_t>(a > b);
    return sign * mixed_a * mixed_b;
}

}  // namespace

SurfaceSums::SurfaceSums(const MeshLayout& layout) {
    if (layout.elements == 0) {
        return;
    }
    Double3 size{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double lo = layout.lo[axis];
        const double hi = layout.hi[axis];
        centre_[axis] = (lo + hi) / 2;
        size[axis] = hi - lo;
    }
    const double diagonal = length(size);
    int exponent = 0;
    std::frexp(diagonal, &exponent);
    area_exponent_ = 2 * exponent - kBits;
    volume_exponent_ = 3 * exponent - kBits;
}

void SurfaceSums::add(const ElementBatch& batch) {
    const double per_area = std::ldexp(1.0, -area_exponent_);
    const double per_volume = std::ldexp(1.0, -volume_exponent_);
    const auto& at = batch.nearby.positions;
    for (std::size_t i = 0; i < batch.corners.size(); ++i) {
        const auto& t = batch.nearby_corners[i];
        const Double3 apex = less(at[t[0]], {0, 0, 0});
        const Double3 normal = cross(less(at[t[1]], apex), less(at[t[2]], apex));
        twice_area_ += static_cast<std::int64_t>(length(normal) * per_area);
        six_volumes_ +=
            static_cast<std::int64_t>(dot(less(at[t[0]], centre_), normal) * per_volume);
        const auto& v = batch.corners[i];
        const std::array<std::uint64_t, 3> m{mixed(v[0]), mixed(v[1]), mixed(v[2])};
        unmatched_ += of_edge(v[0], v[1], m[0], m[1]) + of_edge(v[1], v[2], m[1], m[2]) +
                      of_edge(v[2], v[0], m[2], m[0]);
    }
}

void SurfaceSums::add(const SurfaceSums& other) {
    twice_area_ += other.twice_area_;
    six_volumes_ += other.six_volumes_;
    unmatched_ += other.unmatched_;
}

SurfaceMeasures SurfaceSums::measures() const {
    constexpr double kOfParallelepiped = 1.0 / 6;
    SurfaceMeasures measures;
    measures.area = std::ldexp(static_cast<double>(twice_area_), area_exponent_) / 2;
    if (unmatched_ == 0) {
        measures.volume =
            std::fabs(std::ldexp(static_cast<double>(six_volumes_), volume_exponent_)) *
            kOfParallelepiped;
    }
    return measures;
}

SurfaceMeasures measures_of(const MeshLayout& layout,
                            std::span<const std::array<float, 3>> positions,
                            const CornerView& elements) {
    constexpr std::size_t kAtOnce = 1U << 12U;
    SurfaceSums sums(layout);
    std::vector<std::array<float, 3>> nearby;
    std::vector<std::array<std::uint32_t, 3>> places;
    std::vector<ElementCorners> corners;
    for (std::size_t at = 0; at < elements.size(); at += kAtOnce) {
        const auto some = elements.subspan(at, std::min(kAtOnce, elements.size() - at));
        nearby.clear();
        places.clear();
        corners.assign(some.begin(), some.end());
        for (const auto& t : corners) {
            const auto first = static_cast<std::uint32_t>(nearby.size());
            places.push_back({first, first + 1, first + 2});
            for (const std::uint64_t v : t) {
                nearby.push_back(positions[v]);
            }
        }
        sums.add({at, corners, places, {0, nearby, {}, 0}});
    }
    return sums.measures();
}

}  // namespace isonest::detail
