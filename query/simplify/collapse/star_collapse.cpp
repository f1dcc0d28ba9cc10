#include "query/simplify/collapse/star_collapse.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "query/mesh/vertex_stars.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kNone = CornerMesh::kNone;
/// A triangle is thin if its height is less than this fraction of its longest edge: nearly 5
/// degrees.
constexpr float kThin = 0.087F;

/// Twice the area divided by the square of the longest edge: nearly the sine of the smallest angle.
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
    return box_.faces_of(positions_[v]);
}

/// Whether a border continues in the face in which it comes to the middle.
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
        const auto axis = static_cast<std::size_t>(std::countr_zero(other)) / 2;
        star_.axis = axis < 2 && box_.tilted.at(axis).is_there ? Star::kNone : axis;
    }
    return other != 0 || faces == 0;
}

bool StarCollapse::look(std::uint32_t from, std::uint32_t to, std::uint32_t beyond) {
    mesh_.ring_of(from, ring_);
    const auto at = std::find(ring_.vertices.begin(), ring_.vertices.end(), to);
    if (at == ring_.vertices.end() || ring_.vertices.size() > Star::kMaxCorners) {
        return false;
    }
    place_ = static_cast<std::size_t>(at - ring_.vertices.begin());
    if (!stays_in_faces(from, to) || !mesh_.keeps_topology(ring_, place_, locked_, beyond)) {
        return false;
    }
    turn_ring();
    return true;
}

/// Rotates the ring to start with the vertex that the middle becomes.
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
            // The triangle across may turn at the same time.
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
            (before != Normal{} && cosine(before, turned_[j]) < kMinCosine) ||
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

bool PlacedCollapse::is_inside_box(const std::array<float, 3>& p) const {
    return box_.is_inside(p);
}

void PlacedCollapse::gather(const CornerMesh::Ring& ring) {
    for (const std::uint32_t h : ring.halves) {
        if (std::find(before_.begin(), before_.end(), h / 3) == before_.end()) {
            before_.push_back(h / 3);
        }
    }
}

/// Returns false if the triangle turns too far, or has no area.
bool PlacedCollapse::add(std::uint32_t triangle, const StarCollapse& half) {
    Placed placed{triangle, mesh_.corners(triangle), {}, {}};
    std::array<std::array<float, 3>, 3> at{};
    for (std::size_t i = 0; i < 3; ++i) {
        std::uint32_t& v = placed.corners[i];
        v = v == from_ ? to_ : v;
        at[i] = v == to_ ? place_ : positions_[v];
        placed.at[i] = point_at(at[i]);
    }
    placed.normal = StarCollapse::normal(placed.at[0], placed.at[1], placed.at[2]);
    const StarCollapse::Normal& old = half.normal_of(triangle);
    constexpr StarCollapse::Normal kNoNormal{};
    if (placed.normal == kNoNormal || has_no_area(at[0], at[1], at[2]) ||
        (old != kNoNormal && StarCollapse::cosine(old, placed.normal) < StarCollapse::kMinCosine)) {
        return false;
    }
    after_.push_back(placed);
    return true;
}

bool PlacedCollapse::look(const StarCollapse& half, const std::array<float, 3>& place) {
    from_ = half.ring().middle;
    to_ = half.vertex(0);
    place_ = place;
    before_.clear();
    gone_.clear();
    after_.clear();
    if (half.faces_of(from_) != 0 || half.faces_of(to_) != 0 || !is_inside_box(place) ||
        place == positions_[to_]) {
        return false;
    }
    mesh_.ring_of(to_, ring_);
    if (!half.ring().is_closed || !ring_.is_closed) {
        return false;
    }
    gather(half.ring());
    gather(ring_);
    for (const std::uint32_t t : before_) {
        const PatchTriangle c = mesh_.corners(t);
        const bool has_from = std::find(c.begin(), c.end(), from_) != c.end();
        const bool has_to = std::find(c.begin(), c.end(), to_) != c.end();
        if (has_from && has_to) {
            gone_.push_back(t);
        } else if (!add(t, half)) {
            return false;
        }
    }
    return true;
}

bool PlacedCollapse::is_gone(std::uint32_t triangle) const {
    return std::find(gone_.begin(), gone_.end(), triangle) != gone_.end();
}

/// The opposite half of a changed triangle's edge after the collapse.
std::uint32_t PlacedCollapse::across(std::uint32_t half_edge) const {
    const std::uint32_t other = mesh_.across(half_edge);
    if (other == CornerMesh::kNone || !is_gone(other / 3)) {
        return other;
    }
    // In a removed triangle, the two remaining edges become one.
    const std::uint32_t next = CornerMesh::next(other);
    const auto is_end = [&](std::uint32_t v) { return v == from_ || v == to_; };
    const bool is_collapsed = is_end(mesh_.start(next)) && is_end(mesh_.end(next));
    return mesh_.across(is_collapsed ? CornerMesh::previous(other) : next);
}

bool PlacedCollapse::has_no_new_fold(const StarCollapse& half, float least) const {
    float before = 1;
    for (const std::uint32_t t : before_) {
        for (std::uint32_t h = 3 * t; h < 3 * t + 3; ++h) {
            const std::uint32_t other = mesh_.across(h);
            if (other != CornerMesh::kNone) {
                before = std::min(
                    before, StarCollapse::cosine(half.normal_of(t), half.normal_of(other / 3)));
            }
        }
    }
    const auto now = [&](std::uint32_t triangle) -> const StarCollapse::Normal& {
        const auto placed = std::find_if(after_.begin(), after_.end(),
                                         [&](const Placed& p) { return p.triangle == triangle; });
        return placed == after_.end() ? half.normal_of(triangle) : placed->normal;
    };
    float after = 1;
    for (const Placed& placed : after_) {
        for (std::uint32_t h = 3 * placed.triangle; h < 3 * placed.triangle + 3; ++h) {
            const std::uint32_t other = across(h);
            if (other != CornerMesh::kNone) {
                after = std::min(after, StarCollapse::cosine(placed.normal, now(other / 3)));
            } else if (shared_[mesh_.start(h)] && shared_[mesh_.end(h)]) {
                // The triangle across may turn at the same time.
                return false;
            }
        }
    }
    return after >= least || after >= before;
}

namespace {

double volume_of(const Double3& a, const Double3& b, const Double3& c, const Double3& d) {
    return dot(minus(b, a), cross(minus(c, a), minus(d, a)));
}

/// The numbers k = 0, 1, ... for which all of several linear functions are at least 0, apart from
/// rounding.
class Interval {
  public:
    explicit Interval(std::int64_t last) : upper_(static_cast<double>(last)) {}
    /// Adds the function that is `at_0` at 0 and `at_1` at 1.
    void cut(double at_0, double at_1) {
        const double slope = at_1 - at_0;
        if (slope > 0) {
            lower_ = std::max(lower_, -at_0 / slope - kRounding);
        } else if (slope < 0) {
            upper_ = std::min(upper_, -at_0 / slope + kRounding);
        } else if (at_0 < 0) {
            upper_ = -1;
        }
    }
    [[nodiscard]] bool has_number() const { return std::ceil(lower_) <= std::floor(upper_); }

  private:
    static constexpr double kRounding = 1e-6;
    double lower_ = 0;
    double upper_;
};

}  // namespace

Double3 NodesPassed::in_lattice(const Double3& world) const {
    return lattice_.position_of(world);
}

bool NodesPassed::has_node(const Tetrahedron& t) const {
    Int3 lo{};
    Int3 hi{};
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const auto [least, most] = std::minmax({t[0][a], t[1][a], t[2][a], t[3][a]});
        const auto last = static_cast<double>(lattice_.nodes[axis] - 1);
        lo[axis] = static_cast<std::int64_t>(std::ceil(std::clamp(least - margin_, 0.0, last + 1)));
        hi[axis] = static_cast<std::int64_t>(std::floor(std::clamp(most + margin_, -1.0, last)));
    }
    if (lo.x > hi.x || lo.y > hi.y || lo.z > hi.z) {
        return false;
    }
    // For the face opposite each corner: the unit of a point's distance from the face's plane.
    std::array<double, 4> near{};
    for (std::size_t i = 0; i < 4; ++i) {
        const Double3& a = t[(i + 1) % 4];
        near[i] = margin_ * length(cross(minus(t[(i + 2) % 4], a), minus(t[(i + 3) % 4], a)));
    }
    const auto volumes = [&t](const Double3& p) {
        return std::array<double, 4>{volume_of(p, t[1], t[2], t[3]), volume_of(t[0], p, t[2], t[3]),
                                     volume_of(t[0], t[1], p, t[3]),
                                     volume_of(t[0], t[1], t[2], p)};
    };
    for (std::int64_t z = lo.z; z <= hi.z; ++z) {
        for (std::int64_t y = lo.y; y <= hi.y; ++y) {
            // The volumes are linear along x.
            Double3 p{static_cast<double>(lo.x), static_cast<double>(y), static_cast<double>(z)};
            const auto at_0 = volumes(p);
            p[0] += 1;
            const auto at_1 = volumes(p);
            Interval in(hi.x - lo.x);
            Interval turned(hi.x - lo.x);
            for (std::size_t i = 0; i < 4; ++i) {
                in.cut(at_0[i] + near[i], at_1[i] + near[i]);
                turned.cut(near[i] - at_0[i], near[i] - at_1[i]);
            }
            if (in.has_number() || turned.has_number()) {
                return true;
            }
        }
    }
    return false;
}

bool NodesPassed::any(const Star& star, const Double3& middle, const Double3& slid) const {
    const auto at = [&](const Double3& from_middle) {
        return in_lattice(
            {middle[0] + from_middle[0], middle[1] + from_middle[1], middle[2] + from_middle[2]});
    };
    const Double3 now = at({0, 0, 0});
    const Double3 before = at({-slid[0], -slid[1], -slid[2]});
    const Double3 to = at(star.ring[0]);
    for (std::size_t i = 0; i < star.corners; ++i) {
        if (i == star.missing) {
            continue;
        }
        const Double3 a = at(star.ring[i]);
        const Double3 b = at(star.ring[i + 1 < star.corners ? i + 1 : 0]);
        const bool is_new = i > 0 && i + 1 < star.corners;
        if ((is_new && has_node({now, to, a, b})) ||
            (slid != Double3{} && has_node({before, now, a, b}))) {
            return true;
        }
    }
    return false;
}

}  // namespace isonest::detail
