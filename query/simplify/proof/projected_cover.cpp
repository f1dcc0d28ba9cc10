#include "query/simplify/proof/projected_cover.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace isonest::detail {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
/// Relative to the triangle's size: what is at most this far outside counts as meeting it.
constexpr double kTiny = 1e-9;
/// Barycentric coordinates of an interior point to which nothing on a lattice projects.
constexpr std::array<double, 3> kMiddle{0.34567891, 0.31415927, 0.34016182};
constexpr std::size_t kMaxVisited = 4096;

Double3 scaled(const Double3& a, double s) {
    return {a[0] * s, a[1] * s, a[2] * s};
}

}  // namespace

ProjectedCover::ProjectedCover(std::span<const std::array<float, 3>> positions,
                               std::span<const PatchTriangle> surface, double limit)
    : positions_(positions),
      surface_(surface),
      limit_(limit),
      first_(positions.size() + 1),
      around_(3 * surface.size()),
      beyond_(surface.size()),
      visited_in_(surface.size()),
      seen_in_(positions.size()),
      seen_(positions.size()) {
    for (const PatchTriangle& t : surface) {
        for (const std::uint32_t v : t) {
            ++first_[v + 1];
        }
    }
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
    for (std::uint32_t i = 0; i < surface.size(); ++i) {
        for (const std::uint32_t v : surface[i]) {
            around_[next[v]++] = i;
        }
    }
    for (std::uint32_t i = 0; i < surface.size(); ++i) {
        for (std::size_t e = 0; e < 3; ++e) {
            beyond_[i][e] = beyond(i, e);
        }
    }
}

/// The triangle across the edge starting at corner `edge`; none at a border, or where several meet.
std::uint32_t ProjectedCover::beyond(std::uint32_t triangle, std::size_t edge) const {
    const std::uint32_t a = surface_[triangle][edge];
    const std::uint32_t b = surface_[triangle][(edge + 1) % 3];
    std::uint32_t found = kNone;
    for (std::uint32_t i = first_[a]; i < first_[a + 1]; ++i) {
        const PatchTriangle& t = surface_[around_[i]];
        if (around_[i] == triangle || (t[0] != b && t[1] != b && t[2] != b)) {
            continue;
        }
        const bool other_way =
            (t[0] == b && t[1] == a) || (t[1] == b && t[2] == a) || (t[2] == b && t[0] == a);
        if (!other_way || found != kNone) {
            return kNone;
        }
        found = around_[i];
    }
    return found;
}

void ProjectedCover::look_at(const std::array<Double3, 3>& t) {
    origin_ = t[0];
    const Double3 ab = minus(t[1], t[0]);
    const Double3 n = cross(ab, minus(t[2], t[0]));
    along_ = scaled(ab, 1 / length(ab));
    up_ = scaled(n, 1 / length(n));
    across_ = cross(up_, along_);
    double size = 0;
    middle_ = {};
    for (std::size_t i = 0; i < 3; ++i) {
        const Double3 p = minus(t[i], origin_);
        corner_[i] = {dot(p, along_), dot(p, across_)};
        middle_[0] += kMiddle[i] * corner_[i][0];
        middle_[1] += kMiddle[i] * corner_[i][1];
    }
    for (std::size_t i = 0; i < 3; ++i) {
        const auto& a = corner_[i];
        const auto& b = corner_[(i + 1) % 3];
        const double x = b[0] - a[0];
        const double y = b[1] - a[1];
        const double edge = std::sqrt(x * x + y * y);
        size = std::max(size, edge);
        edge_[i] = {-y / edge, x / edge, (y * a[0] - x * a[1]) / edge};
    }
    tiny_ = kTiny * size;
}

const ProjectedCover::Seen& ProjectedCover::seen(std::uint32_t vertex) {
    Seen& s = seen_[vertex];
    if (seen_in_[vertex] == question_) {
        return s;
    }
    seen_in_[vertex] = question_;
    const auto& p = positions_[vertex];
    const Double3 q{static_cast<double>(p[0]) - origin_[0], static_cast<double>(p[1]) - origin_[1],
                    static_cast<double>(p[2]) - origin_[2]};
    s = {dot(q, along_), dot(q, across_), dot(q, up_), {}};
    for (std::size_t i = 0; i < 3; ++i) {
        s.inside[i] = edge_[i][0] * s.u + edge_[i][1] * s.v + edge_[i][2];
    }
    return s;
}

/// Whether a segment meets the region at least `inside` within all edges of the triangle (< 0:
/// outside): no line along one of the edges or along the segment separates them.
bool ProjectedCover::meets(const Seen& p, const Seen& q, double inside) const {
    for (std::size_t i = 0; i < 3; ++i) {
        if (p.inside[i] < inside && q.inside[i] < inside) {
            return false;
        }
    }
    const double x = q.u - p.u;
    const double y = q.v - p.v;
    const double least = tiny_ * (std::fabs(x) + std::fabs(y));
    int left = 0;
    int right = 0;
    for (const auto& c : corner_) {
        const double side = x * (c[1] - p.v) - y * (c[0] - p.u);
        left += side > least ? 1 : 0;
        right += side < -least ? 1 : 0;
    }
    return left < 3 && right < 3;
}

/// Cuts off the part where `inside` is negative (I. Sutherland, G. Hodgman, 1974).
template <class Inside>
void ProjectedCover::cut(Polygon& polygon, const Inside& inside) {
    Polygon kept;
    for (std::size_t i = 0; i < polygon.count; ++i) {
        const Seen& p = polygon.corner[i];
        const Seen& q = polygon.corner[(i + 1) % polygon.count];
        const double a = inside(p);
        const double b = inside(q);
        if (a >= 0) {
            kept.corner[kept.count++] = p;
        }
        if ((a > 0 && b < 0) || (a < 0 && b > 0)) {
            const double w = a / (a - b);
            Seen& c = kept.corner[kept.count++];
            c = {p.u + w * (q.u - p.u),
                 p.v + w * (q.v - p.v),
                 p.height + w * (q.height - p.height),
                 {}};
            for (std::size_t k = 0; k < 3; ++k) {
                c.inside[k] = p.inside[k] + w * (q.inside[k] - p.inside[k]);
            }
        }
    }
    polygon = kept;
}

/// The height of the part of a triangle above the tested one.
double ProjectedCover::height_over(const SeenTriangle& t) const {
    Polygon over{{*t[0], *t[1], *t[2]}, 3};
    for (std::size_t e = 0; e < 3; ++e) {
        cut(over, [&](const Seen& s) { return s.inside[e] + tiny_; });
    }
    double height = 0;
    for (std::size_t i = 0; i < over.count; ++i) {
        height = std::max(height, std::fabs(over.corner[i].height));
    }
    return height;
}

/// 1 if the middle is under the triangle's front side, -1 under its back side, otherwise 0.
int ProjectedCover::turns_around_middle(const SeenTriangle& t) const {
    int left = 0;
    int right = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        const Seen& p = *t[i];
        const Seen& q = *t[(i + 1) % 3];
        const double side = (q.u - p.u) * (middle_[1] - p.v) - (q.v - p.v) * (middle_[0] - p.u);
        left += side > 0 ? 1 : 0;
        right += side < 0 ? 1 : 0;
    }
    return left == 3 ? 1 : right == 3 ? -1 : 0;
}

/// The lowest of the triangles around the first corner that are above the tested triangle there,
/// front side up; kNone: there is none.
std::uint32_t ProjectedCover::start(std::uint32_t vertex) {
    std::uint32_t best = kNone;
    double least = std::numeric_limits<double>::infinity();
    for (std::uint32_t i = first_[vertex]; i < first_[vertex + 1]; ++i) {
        const PatchTriangle& f = surface_[around_[i]];
        const std::size_t k = f[0] == vertex ? 0 : f[1] == vertex ? 1 : 2;
        const Seen& p = seen(f[(k + 1) % 3]);
        const Seen& q = seen(f[(k + 2) % 3]);
        const double height = std::max(std::fabs(p.height), std::fabs(q.height));
        if (p.u * middle_[1] - p.v * middle_[0] >= 0 && middle_[0] * q.v - middle_[1] * q.u >= 0 &&
            p.u * q.v - p.v * q.u > 0 && height < least) {
            best = around_[i];
            least = height;
        }
    }
    return best;
}

void ProjectedCover::visit(std::uint32_t triangle) {
    if (visited_in_[triangle] != question_) {
        visited_in_[triangle] = question_;
        stack_.push_back(triangle);
    }
}

/// Returns false if there is no starting triangle. The degree does not depend on the starting
/// triangle, because all triangles across edges above the tested one are followed.
bool ProjectedCover::begin(const Triangle& triangle, std::uint32_t near) {
    stack_.clear();
    if (point_at(positions_[near]) == triangle[0]) {
        const std::uint32_t first = start(near);
        if (first != kNone) {
            visit(first);
        }
    } else {
        for (std::uint32_t i = first_[near]; i < first_[near + 1]; ++i) {
            visit(around_[i]);
        }
    }
    return !stack_.empty();
}

std::optional<double> ProjectedCover::covers(const Triangle& triangle, std::uint32_t near) {
    look_at(triangle);
    ++question_;
    if (!begin(triangle, near)) {
        return std::nullopt;
    }
    double highest = 0;
    int degree = 0;
    // The stack grows in the loop. NOLINTNEXTLINE(modernize-loop-convert)
    for (std::size_t next = 0; next < stack_.size(); ++next) {
        const std::uint32_t at = stack_[next];
        const PatchTriangle& f = surface_[at];
        const SeenTriangle s{&seen(f[0]), &seen(f[1]), &seen(f[2])};
        double height =
            std::max({std::fabs(s[0]->height), std::fabs(s[1]->height), std::fabs(s[2]->height)});
        if (height > limit_) {
            height = height_over(s);
        }
        if (height > limit_ || stack_.size() > kMaxVisited) {
            return std::nullopt;
        }
        highest = std::max(highest, height);
        degree += turns_around_middle(s);
        for (std::size_t e = 0; e < 3; ++e) {
            const std::uint32_t other = beyond_[at][e];
            // A border along an edge of the triangle is not inside it.
            if (other != kNone && meets(*s[e], *s[(e + 1) % 3], -tiny_)) {
                visit(other);
            } else if (other == kNone && meets(*s[e], *s[(e + 1) % 3], tiny_)) {
                return std::nullopt;
            }
        }
    }
    if (degree == 0) {
        return std::nullopt;
    }
    return highest;
}

}  // namespace isonest::detail
