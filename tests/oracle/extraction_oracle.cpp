#include "tests/oracle/extraction_oracle.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

namespace isonest::oracle {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Point as_point(const Int3& p) {
    return {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)};
}

Point minus(const Point& a, const Point& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

Point cross(const Point& a, const Point& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

double dot(const Point& a, const Point& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

void visit(const BisectionOracle& volume, const NodalField& stop, const NodalField& bound,
           double eps, double iso, const Simplex& t, Traversal& result) {
    ++result.visited;
    const bool missing = volume.has_missing_vertex(t);
    if (!missing) {
        const double beta = t.is_finest() ? 0 : bound.at(t.refinement_node());
        double low = volume.value(t.v[0]);
        double high = low;
        for (const Int3& p : t.v) {
            low = std::min(low, volume.value(p));
            high = std::max(high, volume.value(p));
        }
        if (iso < low - beta || iso > high + beta) {
            return;
        }
    }
    if (!t.is_finest() && stop.at(t.refinement_node()) >= eps) {
        for (const Simplex& child : volume.children(t)) {
            visit(volume, stop, bound, eps, iso, child, result);
        }
    } else if (missing) {
        ++result.missing;
    } else {
        result.leaves.push_back(t);
    }
}

/// Where the edge between two nodes on different sides crosses iso.
Point crossing(const BisectionOracle& volume, Int3 a, Int3 b, double iso) {
    if (std::tie(a.z, a.y, a.x) > std::tie(b.z, b.y, b.x)) {
        std::swap(a, b);
    }
    const double ua = volume.value(a);
    const double ub = volume.value(b);
    // Halved, so that the difference of the largest numbers stays finite.
    const double t = (iso / 2 - ua / 2) / (ub / 2 - ua / 2);
    Point p = as_point(a);
    const Point q = as_point(b);
    for (std::size_t i = 0; i < 3; ++i) {
        p[i] = t == 1 ? q[i] : p[i] + t * (q[i] - p[i]);
    }
    return p;
}

/// Appends the triangle, turned so that `below`, a node under iso, is on the side of its normal.
void append(std::vector<Triangle>& out, Triangle t, const Int3& below) {
    const Point normal = cross(minus(t[1], t[0]), minus(t[2], t[0]));
    if (dot(normal, minus(as_point(below), t[0])) < 0) {
        std::swap(t[1], t[2]);
    }
    out.push_back(t);
}

/// The part of a polygon with sign * (p[axis] - plane) >= 0.
std::vector<Point> half_space(const std::vector<Point>& polygon, std::size_t axis, double plane,
                              double sign) {
    std::vector<Point> out;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
        const Point& a = polygon[i];
        const Point& b = polygon[(i + 1) % polygon.size()];
        const double da = sign * (a[axis] - plane);
        const double db = sign * (b[axis] - plane);
        if (da >= 0) {
            out.push_back(a);
        }
        if ((da > 0 && db < 0) || (da < 0 && db > 0)) {
            const double t = da / (da - db);
            Point p{};
            for (std::size_t k = 0; k < 3; ++k) {
                p[k] = a[k] + t * (b[k] - a[k]);
            }
            p[axis] = plane;
            out.push_back(p);
        }
    }
    return out;
}

}  // namespace

Traversal adapt_traverse(const BisectionOracle& volume, const NodalField& stop,
                         const NodalField& bound, double eps, double iso) {
    Traversal result;
    for (const Simplex& t : volume.roots()) {
        visit(volume, stop, bound, eps, iso, t, result);
    }
    return result;
}

std::vector<Triangle> march(const BisectionOracle& volume, const std::vector<Simplex>& leaves,
                            double iso) {
    std::vector<Triangle> out;
    for (const Simplex& t : leaves) {
        if (volume.has_missing_vertex(t)) {
            continue;
        }
        std::vector<Int3> in;
        std::vector<Int3> below;
        for (const Int3& p : t.v) {
            (volume.value(p) >= iso ? in : below).push_back(p);
        }
        const auto cut = [&](std::size_t i, std::size_t j) {
            return crossing(volume, in[i], below[j], iso);
        };
        if (in.size() == 1) {
            append(out, {cut(0, 0), cut(0, 1), cut(0, 2)}, below[0]);
        } else if (in.size() == 3) {
            append(out, {cut(0, 0), cut(1, 0), cut(2, 0)}, below[0]);
        } else if (in.size() == 2) {
            append(out, {cut(0, 0), cut(0, 1), cut(1, 1)}, below[0]);
            append(out, {cut(0, 0), cut(1, 1), cut(1, 0)}, below[0]);
        }
    }
    return out;
}

std::vector<Triangle> without_degenerate(const std::vector<Triangle>& triangles) {
    std::vector<Triangle> out;
    std::copy_if(triangles.begin(), triangles.end(), std::back_inserter(out),
                 [](const Triangle& t) { return t[0] != t[1] && t[1] != t[2] && t[2] != t[0]; });
    return out;
}

std::vector<Triangle> clipped(const std::vector<Triangle>& triangles, const Point& lo,
                              const Point& hi) {
    std::vector<Triangle> out;
    for (const Triangle& t : triangles) {
        std::vector<Point> polygon(t.begin(), t.end());
        for (std::size_t axis = 0; axis < 3; ++axis) {
            polygon = half_space(polygon, axis, lo[axis], 1);
            polygon = half_space(polygon, axis, hi[axis], -1);
        }
        for (std::size_t i = 2; i < polygon.size(); ++i) {
            out.push_back({polygon[0], polygon[i - 1], polygon[i]});
        }
    }
    return out;
}

double area(const std::vector<Triangle>& triangles, const Double3& spacing) {
    double sum = 0;
    for (const Triangle& t : triangles) {
        Point u = minus(t[1], t[0]);
        Point w = minus(t[2], t[0]);
        for (std::size_t i = 0; i < 3; ++i) {
            u[i] *= spacing[i];
            w[i] *= spacing[i];
        }
        const Point n = cross(u, w);
        sum += std::hypot(n[0], n[1], n[2]) / 2;
    }
    return sum;
}

std::vector<Point> distinct_corners(const std::vector<Triangle>& triangles) {
    std::vector<Point> out;
    for (const Triangle& t : triangles) {
        out.insert(out.end(), t.begin(), t.end());
    }
    std::sort(out.begin(), out.end());
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
}

double fine_value(const BisectionOracle& volume, const Point& p) {
    Int3 cube;
    Point inside{};
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const auto last = volume.nodes()[axis] - 1;
        inside[a] = std::clamp(p[a], 0.0, static_cast<double>(last));
        cube[axis] = std::clamp<std::int64_t>(static_cast<std::int64_t>(std::floor(inside[a])), 0,
                                              std::max<std::int64_t>(last - 1, 0));
    }
    double best = -2;
    double result = kNan;
    for (const Simplex& t : kuhn_simplices(cube, 1)) {
        const Barycentric b = t.barycentric();
        std::array<double, 4> weights{};
        for (std::size_t i = 0; i < 4; ++i) {
            // Relative to the opposite face's vertex, so that nothing cancels far from the origin.
            weights[i] = dot(as_point(b.slope[i]), minus(inside, as_point(t.v[(i + 1) % 4])));
        }
        const double least = *std::min_element(weights.begin(), weights.end());
        if (least <= best) {
            continue;
        }
        best = least;
        result = 0;
        for (std::size_t i = 0; i < 4; ++i) {
            if (weights[i] > 0) {
                const double u = volume.value(t.v[i]);
                result += std::isfinite(u) ? weights[i] * u : kNan;
            }
        }
        if (least >= 0) {
            break;
        }
    }
    return result;
}

}  // namespace isonest::oracle
