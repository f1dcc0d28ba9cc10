// Cuts triangles at planes of a grid, so that triangles with a common edge are cut at the same
// points.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include <isonest/int3.h>

namespace isonest::detail {

// What a corner must provide; here for corners that are mere positions.

inline const Double3& place_of(const Double3& corner) {
    return corner;
}

/// The point where the edge from `below` to `above` meets the plane. It depends only on the ends,
/// not on the triangle; the coordinate along `axis` is exact.
inline Double3 meeting_point(const Double3& below, const Double3& above, std::size_t axis,
                             double plane) {
    const double t = (plane - below[axis]) / (above[axis] - below[axis]);
    Double3 p{};
    for (std::size_t i = 0; i < 3; ++i) {
        const auto [least, most] = std::minmax(below[i], above[i]);
        p[i] = std::clamp(below[i] + t * (above[i] - below[i]), least, most);
    }
    p[axis] = plane;
    return p;
}

/// A convex polygon in space: a triangle, or what is left of it after cutting.
template <class Corner>
class CutPolygon {
  public:
    /// Two planes of each axis add one corner each to a triangle; the rest allows for rounding.
    static constexpr std::size_t kMax = 16;

    CutPolygon() = default;
    CutPolygon(const Corner& a, const Corner& b, const Corner& c) : corners_{a, b, c}, size_(3) {}

    [[nodiscard]] std::size_t size() const { return size_; }
    const Corner& operator[](std::size_t i) const { return corners_[i]; }
    /// Does nothing if there is no room, which can only be caused by rounding.
    void add(const Corner& corner) {
        if (size_ < kMax) {
            corners_[size_++] = corner;
        }
    }
    /// The smallest and the largest coordinate.
    [[nodiscard]] std::array<double, 2> range(std::size_t axis) const {
        std::array<double, 2> r{place_of(corners_[0])[axis], place_of(corners_[0])[axis]};
        for (std::size_t i = 1; i < size_; ++i) {
            r[0] = std::min(r[0], place_of(corners_[i])[axis]);
            r[1] = std::max(r[1], place_of(corners_[i])[axis]);
        }
        return r;
    }

  private:
    std::array<Corner, kMax> corners_{};
    std::size_t size_ = 0;
};

/// The parts of the polygon below and above a plane that crosses it. The section by the plane is an
/// edge of both.
template <class Corner>
std::array<CutPolygon<Corner>, 2> halves_of(const CutPolygon<Corner>& polygon, std::size_t axis,
                                            double plane) {
    std::array<CutPolygon<Corner>, 2> halves;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
        const Corner& from = polygon[i];
        const Corner& to = polygon[i + 1 < polygon.size() ? i + 1 : 0];
        const double d = place_of(from)[axis] - plane;
        const double e = place_of(to)[axis] - plane;
        if (d <= 0) {
            halves[0].add(from);
        }
        if (d >= 0) {
            halves[1].add(from);
        }
        if ((d < 0 && e > 0) || (d > 0 && e < 0)) {
            const Corner p =
                d < 0 ? meeting_point(from, to, axis, plane) : meeting_point(to, from, axis, plane);
            halves[0].add(p);
            halves[1].add(p);
        }
    }
    return halves;
}

/// Calls `visit(strip, polygon)` with the parts of the polygon between planes at whole numbers,
/// along `axis` and the following ones: `strip` is the interval along each axis. Parts in a plane
/// belong to the strip below it. Coordinates are at least 0.
template <class Corner, class Visit>
void cut_at_planes(const CutPolygon<Corner>& polygon, std::size_t axis, Int3 strip,
                   const Visit& visit) {
    if (axis == 3) {
        visit(strip, polygon);
        return;
    }
    CutPolygon<Corner> rest = polygon;
    const auto [least, most] = polygon.range(axis);
    double at = std::floor(least);
    if (least == most && at == least) {
        at = std::max(at - 1, 0.0);
    }
    // Whole numbers, far below the limit of double.
    for (; at + 1 < most; ++at) {  // NOLINT(bugprone-float-loop-counter)
        const auto [below, above] = halves_of(rest, axis, at + 1);
        strip[static_cast<int>(axis)] = static_cast<std::int64_t>(at);
        cut_at_planes(below, axis + 1, strip, visit);
        rest = above;
    }
    strip[static_cast<int>(axis)] = static_cast<std::int64_t>(at);
    cut_at_planes(rest, axis + 1, strip, visit);
}

}  // namespace isonest::detail
