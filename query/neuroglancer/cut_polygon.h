// Triangles cut at planes of a grid, so that those with a common edge are cut in the same points.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include <isonest/int3.h>

namespace isonest::detail {

/// A convex polygon in space: a triangle, or what planes leave of it.
class CutPolygon {
  public:
    /// Two planes of each axis add a corner each to a triangle; the rest is for rounding.
    static constexpr std::size_t kMost = 16;

    CutPolygon() = default;
    CutPolygon(const Double3& a, const Double3& b, const Double3& c)
        : corners_{a, b, c}, size_(3) {}

    [[nodiscard]] std::size_t size() const { return size_; }
    const Double3& operator[](std::size_t i) const { return corners_[i]; }
    /// Does nothing if there is no room, which rounding alone could bring about.
    void add(const Double3& corner) {
        if (size_ < kMost) {
            corners_[size_++] = corner;
        }
    }
    /// The smallest and the largest coordinate.
    [[nodiscard]] std::array<double, 2> range(std::size_t axis) const {
        std::array<double, 2> r{corners_[0][axis], corners_[0][axis]};
        for (std::size_t i = 1; i < size_; ++i) {
            r[0] = std::min(r[0], corners_[i][axis]);
            r[1] = std::max(r[1], corners_[i][axis]);
        }
        return r;
    }

  private:
    std::array<Double3, kMost> corners_{};
    std::size_t size_ = 0;
};

/// Where the edge from `below` to `above` the plane meets it. It depends on its ends alone, not on
/// the triangle; the coordinate along `axis` is exact.
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

/// What of the polygon lies below a plane that crosses it, and what above. Both have the part of
/// the plane between them as an edge.
inline std::array<CutPolygon, 2> halves_of(const CutPolygon& polygon, std::size_t axis,
                                           double plane) {
    std::array<CutPolygon, 2> halves;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
        const Double3& from = polygon[i];
        const Double3& to = polygon[i + 1 < polygon.size() ? i + 1 : 0];
        const double d = from[axis] - plane;
        const double e = to[axis] - plane;
        if (d <= 0) {
            halves[0].add(from);
        }
        if (d >= 0) {
            halves[1].add(from);
        }
        if ((d < 0 && e > 0) || (d > 0 && e < 0)) {
            const Double3 p =
                d < 0 ? meeting_point(from, to, axis, plane) : meeting_point(to, from, axis, plane);
            halves[0].add(p);
            halves[1].add(p);
        }
    }
    return halves;
}

/// Calls `visit(strip, polygon)` with the parts of the polygon between planes at whole numbers,
/// along `axis` and those behind it: `strip` says between which ones along each axis. What lies in
/// a plane belongs to the strip below it. Coordinates are at least 0.
template <class Visit>
void cut_at_planes(const CutPolygon& polygon, std::size_t axis, Int3 strip, const Visit& visit) {
    if (axis == 3) {
        visit(strip, polygon);
        return;
    }
    CutPolygon rest = polygon;
    const auto [least, most] = polygon.range(axis);
    double at = std::floor(least);
    if (least == most && at == least) {
        at = std::max(at - 1, 0.0);
    }
    // Whole numbers, far below those that double has no more.
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
