#include "query/simplify/collapse/star_collapse.h"

#include <algorithm>
#include <bit>

#include "query/mesh/zero_area.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kNone = CornerMesh::kNone;
/// A triangle is thin if its height is less than this part of its longest edge: 5 degrees, nearly.
constexpr float kThin = 0.087F;

/// Twice the area over the square of the longest edge: the sine of the smallest angle, nearly.
float thickness(const Double3& a, const Double3& b, const Double3& c) {
    const Double3 ab = minus(b, a);
    const Double3 ac = minus(c, a);
    const double longest = std::max({square(ab), square(ac), square(minus(c, b))});
    return longest > 0 ? static_cast<float>(length(cross(ab, ac)) / longest) : 0;
}

}  // namespace

StarCollapse::StarCollapse(std::span<const std::array<float, 3>> positions, const PatchBox& box,
                           const std::vector<bool>& shared, const std::vector<bool>& locked,
                           CornerMesh& mesh)
    : positions_(positions),
      box_(box),
      shared_(shared),
      locked_(locked),
      mesh_(mesh),
      normals_(mesh.triangles()) {
    for (std::uint32_t t = 0; t < normals_.size(); ++t) {
        const PatchTriangle c = mesh.corners(t);
        normals_[t] = normal(point(c[0]), point(c[1]), point(c[2]));
    }
}

/// Of length 1, or 0.
StarCollapse::Normal StarCollapse::normal(const Double3& a, const Double3& b, const Double3& c) {
    const Double3 n = cross(minus(b, a), minus(c, a));
    const double size = length(n);
    if (!(size > 0)) {
        return {};
    }
    return {static_cast<float>(n[0] / size), static_cast<float>(n[1] / size),
            static_cast<float>(n[2] / size)};
}

float StarCollapse::cosine(const Normal& a, const Normal& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

unsigned StarCollapse::faces_of(std::uint32_t v) const {
    unsigned faces = 0;
    for (unsigned axis = 0; axis < 3; ++axis) {
        const float x = positions_[v][axis];
        faces |= x == box_.lo[axis] ? 1U << (2 * axis) : 0U;
        faces |= x == box_.hi[axis] ? 2U << (2 * axis) : 0U;
    }
    return faces;
}

/// A border goes on in the face in which it comes to the middle.
bool StarCollapse::stays_in_faces(std::uint32_t from, std::uint32_t to) {
    star_.axis = Star::kNone;
    const unsigned faces = faces_of(from);
    if ((faces & ~faces_of(to)) != 0) {
        return false;
    }
    if (ring_.is_closed) {
        return true;
    }
    const unsigned other = faces & faces_of(place_ == 0 ? ring_.vertices.back()  //
                                                        : ring_.vertices.front());
    if (std::popcount(other) == 1) {
        star_.axis = static_cast<std::size_t>(std::countr_zero(other)) / 2;
    }
    return other != 0 || faces == 0;
}

bool StarCollapse::look(std::uint32_t from, std::uint32_t to, std::uint32_t beyond) {
    mesh_.ring_of(from, ring_);
    const auto at = std::find(ring_.vertices.begin(), ring_.vertices.end(), to);
    if (at == ring_.vertices.end() || ring_.vertices.size() > Star::kMostCorners) {
        return false;
    }
    place_ = static_cast<std::size_t>(at - ring_.vertices.begin());
    if (!stays_in_faces(from, to) || !mesh_.keeps_topology(ring_, place_, locked_, beyond)) {
        return false;
    }
    turn_ring();
    return true;
}

/// So that it begins with the vertex that the middle becomes.
void StarCollapse::turn_ring() {
    const std::size_t n = ring_.vertices.size();
    star_.corners = n;
    star_.missing = ring_.is_closed ? Star::kNone : place_ == 0 ? n - 1 : 0;
    star_.is_straight = false;
    const Double3 from = point(ring_.middle);
    for (std::size_t i = 0; i < n; ++i) {
        const std::size_t k = place_ + i < n ? place_ + i : place_ + i - n;
        star_.ring[i] = minus(point(ring_.vertices[k]), from);
        half_[i] = k < ring_.halves.size() ? ring_.halves[k] : kNone;
    }
}

void StarCollapse::slide(const Double3& by) {
    star_.is_straight = true;
    for (std::size_t i = 0; i < star_.corners; ++i) {
        star_.ring[i] = minus(star_.ring[i], by);
    }
}

bool StarCollapse::has_no_new_needle() const {
    const std::size_t n = star_.corners;
    const auto& p = star_.ring;
    float after = 1;
    for (std::size_t j = 1; j + 1 < n; ++j) {
        after = std::min(after, thickness(p[0], p[j], p[j + 1]));
    }
    if (after >= kThin) {
        return true;
    }
    float before = 1;
    for (std::size_t i = 0; i < n; ++i) {
        if (half_[i] != kNone) {
            before = std::min(before, thickness({0, 0, 0}, p[i], p[i + 1 < n ? i + 1 : 0]));
        }
    }
    return after >= before;
}

bool StarCollapse::has_no_new_fold(float least) {
    const std::size_t n = star_.corners;
    float before = 1;
    float after = 1;
    const auto old = [&](std::size_t i) -> const Normal& { return normals_[triangle(i)]; };
    for (std::size_t j = 1; j + 1 < n; ++j) {
        turned_[j] = normal(star_.ring[0], star_.ring[j], star_.ring[j + 1]);
    }
    for (std::size_t i = 0; i < n; ++i) {
        if (half_[i] == kNone) {
            continue;
        }
        const std::size_t next = i + 1 < n ? i + 1 : 0;
        if (half_[next] != kNone) {
            before = std::min(before, cosine(old(i), old(next)));
        }
        const Normal& now = turned_[std::clamp<std::size_t>(i, 1, n - 2)];
        const std::uint32_t edge = CornerMesh::next(half_[i]);
        const std::uint32_t beyond = mesh_.across(edge);
        if (beyond != kNone) {
            const Normal& other = normals_[beyond / 3];
            before = std::min(before, cosine(old(i), other));
            after = std::min(after, cosine(now, other));
        } else if (shared_[mesh_.start(edge)] && shared_[mesh_.end(edge)]) {
            // What lies across may turn at the same time.
            return false;
        }
    }
    for (std::size_t j = 1; j + 2 < n; ++j) {
        after = std::min(after, cosine(turned_[j], turned_[j + 1]));
    }
    return after >= least || after >= before;
}

bool StarCollapse::turns_little() const {
    const auto& p = positions_;
    for (std::size_t j = 1; j + 1 < star_.corners; ++j) {
        const PatchTriangle t = after(j);
        const Normal& before = normals_[triangle(j)];
        if (turned_[j] == Normal{} ||
            (before != Normal{} && cosine(before, turned_[j]) < kLeastCosine) ||
            has_no_area(p[t[0]], p[t[1]], p[t[2]])) {
            return false;
        }
    }
    return true;
}

void StarCollapse::take_moved() {
    const std::uint32_t to = ring_.vertices[place_];
    mesh_.collapse(ring_, place_);
    mesh_.ring_of(to, ring_);
    for (const std::uint32_t h : ring_.halves) {
        const PatchTriangle t = mesh_.corners(h / 3);
        normals_[h / 3] = normal(point(t[0]), point(t[1]), point(t[2]));
    }
}

void StarCollapse::take() {
    for (std::size_t j = 1; j + 1 < star_.corners; ++j) {
        normals_[triangle(j)] = turned_[j];
    }
    const std::uint32_t to = ring_.vertices[place_];
    mesh_.collapse(ring_, place_);
    mesh_.ring_of(to, ring_);
}

}  // namespace isonest::detail
