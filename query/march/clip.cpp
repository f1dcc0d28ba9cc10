#include "query/march/clip.h"

#include <algorithm>
#include <cmath>

namespace isonest::detail {
namespace {

/// Whether a triangle lies in a face of the box.
bool is_in_face(const ClipContext& clip, const std::array<std::uint32_t, 3>& triangle,
                std::size_t axis, double limit) {
    return std::all_of(triangle.begin(), triangle.end(),
                       [&](std::uint32_t v) { return clip.position(v)[axis] == limit; });
}

/// Whether the triangles around a vertex in a face of the box may meet that face more than twice.
/// This is impossible if the vertex is on an edge in the face, because then each half of the face
/// at the edge runs through one element or between two, where the surface is plane. Edges run along
/// axes and diagonals between nodes: one that crosses a face through nodes does so where all
/// coordinates are integers. In hexahedra the surface is not plane, and a few vertices with several
/// fans are missed (tests/TRUST.md).
bool may_have_fans(const Double3& vertex, double limit) {
    constexpr double kRounding = 1e-6;
    const auto is_whole = [](double x) { return std::fabs(x - std::round(x)) <= kRounding; };
    return !is_whole(limit) || std::all_of(vertex.begin(), vertex.end(), is_whole);
}

}  // namespace

std::uint32_t ClipContext::crossing(const std::array<std::uint32_t, 3>& triangle, const Side& from,
                                    const Side& to, std::uint32_t plane) {
    const std::size_t axis = plane / 2;
    const double limit = (plane & 1U) == 0 ? box_.lo[axis] : box_.hi[axis];
    CutVertex c;
    c.plane = plane;
    c.inside_triangle = from.edge == 3;
    const std::uint32_t a = c.inside_triangle ? from.v : triangle[from.edge];
    const std::uint32_t b = c.inside_triangle ? to.v : triangle[(from.edge + 1) % 3];
    c.end0 = std::min(a, b);
    c.end1 = std::max(a, b);
    const auto next = first_new_ + static_cast<std::uint32_t>(vertices_.size());
    if (!c.inside_triangle) {
        const auto [it, inserted] = index_.try_emplace({c.end0, c.end1, plane}, next);
        if (!inserted) {
            return it->second;
        }
    }
    // Interpolated between the ends of the whole edge, lower coordinates first: bit for bit the
    // same from both sides and in every part.
    Double3 p = position(a);
    Double3 q = position(b);
    c.from = a;
    c.to = b;
    if (q < p) {
        std::swap(p, q);
        std::swap(c.from, c.to);
    }
    const double t = (limit - p[axis]) / (q[axis] - p[axis]);
    for (std::size_t i = 0; i < 3; ++i) {
        c.position[i] = p[i] + t * (q[i] - p[i]);
    }
    c.position[axis] = limit;
    c.t = t;
    vertices_.push_back(c);
    return next;
}

std::vector<std::array<std::uint32_t, 3>> ClipContext::cut(
    const std::array<std::uint32_t, 3>& triangle) {
    std::vector<Side> polygon{{triangle[0], 0}, {triangle[1], 1}, {triangle[2], 2}};
    std::vector<Side> kept;
    for (std::uint32_t plane = 0; plane < 6 && !polygon.empty(); ++plane) {
        const std::size_t axis = plane / 2;
        const bool low = (plane & 1U) == 0;
        const double limit = low ? box_.lo[axis] : box_.hi[axis];
        // Distance to the inside: > 0 inside, 0 on the plane, < 0 outside.
        const auto inside = [&](const Side& s) {
            const double x = position(s.v)[axis];
            return low ? x - limit : limit - x;
        };
        kept.clear();
        bool any = false;
        bool reaches_out = false;
        std::uint64_t in_face = 0;
        for (std::size_t i = 0; i < polygon.size(); ++i) {
            const Side& from = polygon[i];
            const Side& to = polygon[(i + 1) % polygon.size()];
            const double d0 = inside(from);
            const double d1 = inside(to);
            any = any || d0 > 0;
            reaches_out = reaches_out || d0 < 0;
            in_face += d0 == 0 && may_have_fans(position(from.v), limit) ? 1 : 0;
            if (d0 >= 0) {
                // A side that leaves exactly through this corner is replaced by the plane's.
                kept.push_back({from.v, d1 < 0 && d0 == 0 ? 3 : from.edge});
            }
            if ((d0 > 0 && d1 < 0) || (d0 < 0 && d1 > 0)) {
                const std::uint32_t v = crossing(triangle, from, to, plane);
                kept.push_back({v, d0 > 0 ? 3 : from.edge});
            }
        }
        const bool goes = !any && !is_in_face(*this, triangle, axis, limit);
        cut_fans_ += goes || reaches_out ? in_face : 0;
        if (goes) {
            return {};
        }
        polygon.swap(kept);
    }
    std::vector<std::array<std::uint32_t, 3>> out;
    for (std::size_t i = 2; i < polygon.size(); ++i) {
        out.push_back({polygon[0].v, polygon[i - 1].v, polygon[i].v});
    }
    return out;
}

}  // namespace isonest::detail
