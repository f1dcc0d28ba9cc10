// Triangles around vertices, and those without area.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include <isonest/int3.h>

#include "query/mesh/scratch_mesh.h"
#include "store/base/vectors.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// The effect of rounding to float32 on the coordinates of a mesh, and the planes of a box for
// rounded vertices.

/// The smallest and the largest coordinate along an axis of a box of lattice coordinates, in own
/// axes.
inline std::array<double, 2> reach_of(const Double3& lo, const Double3& hi,
                                      const LatticeSteps& steps, const Double3& origin,
                                      std::size_t axis) {
    if (!steps.is_sheared()) {
        return {origin[axis] + steps.offset(axis, lo[axis]),
                origin[axis] + steps.offset(axis, hi[axis])};
    }
    std::array<double, 2> reach{origin[axis] + steps.along[axis] * lo[axis],
                                origin[axis] + steps.along[axis] * hi[axis]};
    const auto add = [&](double by, std::size_t other) {
        reach[0] += std::min(by * lo[other], by * hi[other]);
        reach[1] += std::max(by * lo[other], by * hi[other]);
    };
    if (axis == 0) {
        add(steps.y_along_x, 1);
        add(steps.z_along_x, 2);
    } else if (axis == 1) {
        add(steps.z_along_y, 2);
    }
    return reach;
}

/// The largest absolute coordinate of nodes along an axis, world units.
inline double largest_coordinate(const Int3& nodes, const LatticeSteps& steps,
                                 const Double3& origin, int axis) {
    const Int3 last = nodes - Int3{1, 1, 1};
    const auto reach = reach_of(
        {0, 0, 0},
        {static_cast<double>(last.x), static_cast<double>(last.y), static_cast<double>(last.z)},
        steps, origin, static_cast<std::size_t>(axis));
    return std::max(std::fabs(reach[0]), std::fabs(reach[1]));
}

/// Maximum rounding error of a coordinate, as a multiple of the distance between neighbouring
/// nodes. `nodes`: number along each axis. REQUIRES: world coordinates within float32.
inline double coordinate_rounding(const Int3& nodes, const LatticeSteps& steps,
                                  const Double3& origin) {
    const Double3 least = steps.min_along();
    double most = 0;
    Double3 half{};
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const auto largest = static_cast<float>(largest_coordinate(nodes, steps, origin, axis));
        const double next = std::nextafter(largest, 0.0F);
        if (nodes[axis] > 1) {
            half[a] = (static_cast<double>(largest) - next) / 2;
            most = std::max(most, half[a] / least[a]);
        }
    }
    return steps.is_sheared() ? steps.max_steps(half) : most;
}

/// Maximum over the axes of a movement in world units, as a multiple of the distance between
/// neighbouring nodes.
inline double max_in_lattice(const Double3& moved, const LatticeSteps& steps) {
    if (steps.is_sheared()) {
        return steps.max_steps(moved);
    }
    const Double3 least = steps.min_along();
    double most = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        if (moved[axis] > 0) {
            most = std::max(most, moved[axis] / std::fabs(least[axis]));
        }
    }
    return most;
}

/// Where a surface is cut or closed. In the same form as vertices: world coordinates in own axes,
/// float32.
struct BoxFaces {
    static constexpr float kNowhere = std::numeric_limits<float>::quiet_NaN();
    /// Faces in planes of own axes; vertices in them have exactly this coordinate. NaN: there is
    /// none.
    std::array<float, 3> lo{kNowhere, kNowhere, kNowhere};
    std::array<float, 3> hi{kNowhere, kNowhere, kNowhere};
    /// The faces across a sheared axis.
    struct Tilted {
        bool is_there = false;
        Double3 normal{};  ///< of length 1
        double lo = 0;     ///< along it
        double hi = 0;
        double near = 0;  ///< maximum movement of a vertex in them by rounding
    };
    std::array<Tilted, 2> tilted{};  ///< across x and y

    /// The faces that contain the point: bits 2 axis (the low one) and 2 axis + 1.
    [[nodiscard]] unsigned faces_of(const std::array<float, 3>& p) const {
        unsigned faces = 0;
        for (unsigned axis = 0; axis < 3; ++axis) {
            faces |= p[axis] == lo[axis] ? 1U << (2 * axis) : 0U;
            faces |= p[axis] == hi[axis] ? 2U << (2 * axis) : 0U;
        }
        for (unsigned axis = 0; axis < 2; ++axis) {
            if (const Tilted& t = tilted[axis]; t.is_there) {
                const double at = along(t, p);
                faces |= std::fabs(at - t.lo) <= t.near ? 1U << (2 * axis) : 0U;
                faces |= std::fabs(at - t.hi) <= t.near ? 2U << (2 * axis) : 0U;
            }
        }
        return faces;
    }
    /// Whether the point is neither beyond nor in a face.
    [[nodiscard]] bool is_inside(const std::array<float, 3>& p) const {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            // If there is no face, the limit is NaN.
            if (p[axis] <= lo[axis] || p[axis] >= hi[axis]) {
                return false;
            }
        }
        for (const Tilted& t : tilted) {
            if (t.is_there && (along(t, p) <= t.lo + t.near || along(t, p) >= t.hi - t.near)) {
                return false;
            }
        }
        return true;
    }

  private:
    [[nodiscard]] static double along(const Tilted& t, const std::array<float, 3>& p) {
        return t.normal[0] * static_cast<double>(p[0]) + t.normal[1] * static_cast<double>(p[1]) +
               t.normal[2] * static_cast<double>(p[2]);
    }
};

/// Faces of the box from `lo` to `hi`, lattice coordinates. `near`: how far rounding moves a
/// vertex, world units.
inline BoxFaces box_faces(const Double3& lo, const Double3& hi, const LatticeSteps& steps,
                          const Double3& origin, double near) {
    const std::array plane{steps.y_along_x == 0 && steps.z_along_x == 0, steps.z_along_y == 0,
                           true};
    BoxFaces faces;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        if (plane.at(axis)) {
            faces.lo[axis] = static_cast<float>(origin[axis] + steps.offset(axis, lo[axis]));
            faces.hi[axis] = static_cast<float>(origin[axis] + steps.offset(axis, hi[axis]));
            continue;
        }
        // The gradient of the lattice coordinate.
        Double3 change{};
        change[axis] = 1 / steps.along[axis];
        Double3 normal = steps.gradient(change);
        const double size = length(normal);
        for (double& component : normal) {
            component /= size;
        }
        const double first = dot(normal, origin);
        faces.tilted.at(axis) = {true, normal, first + lo[axis] / size, first + hi[axis] / size,
                                 near};
    }
    return faces;
}

// Triangles that have no area.
//
// Source of the exact sum: J. R. Shewchuk, "Adaptive precision floating-point arithmetic and fast
// robust geometric predicates", Discrete & Computational Geometry 18 (1997), section 2.4.

/// Whether the sum is exactly 0. REQUIRES: no overflow.
template <std::size_t N>
bool is_zero_sum(const std::array<double, N>& terms) {
    // Terms that do not overlap: their sum is that of the terms so far.
    std::array<double, N> parts{};
    std::size_t count = 0;
    for (double x : terms) {
        std::size_t kept = 0;
        for (std::size_t i = 0; i < count; ++i) {
            const double sum = x + parts[i];
            const double virtual_part = sum - x;
            const double rest = (x - (sum - virtual_part)) + (parts[i] - virtual_part);
            if (rest != 0) {
                parts[kept++] = rest;
            }
            x = sum;
        }
        count = kept;
        if (x != 0) {
            parts[count++] = x;
        }
    }
    return count == 0;
}

/// Whether the corners are on a line, or some are equal; exact, so independent of their order.
inline bool has_no_area(const std::array<float, 3>& a, const std::array<float, 3>& b,
                        const std::array<float, 3>& c) {
    constexpr double kRounding = 1e-15;  // maximum, for a sum or difference of two products
    const auto is_flat = [&](std::size_t i, std::size_t j) {
        const auto d = [&a](const std::array<float, 3>& q, std::size_t axis) {
            return static_cast<double>(q[axis]) - static_cast<double>(a[axis]);
        };
        const double left = d(b, i) * d(c, j);
        const double right = d(b, j) * d(c, i);
        if (std::fabs(left - right) > kRounding * (std::fabs(left) + std::fabs(right))) {
            return false;
        }
        // Products of floats are exact in double.
        const auto product = [](float x, float y) {
            return static_cast<double>(x) * static_cast<double>(y);
        };
        return is_zero_sum<6>({product(a[i], b[j]), -product(a[j], b[i]), product(b[i], c[j]),
                               -product(b[j], c[i]), product(c[i], a[j]), -product(c[j], a[i])});
    };
    return is_flat(1, 2) && is_flat(2, 0) && is_flat(0, 1);
}

// The triangles around some vertices of a mesh that is being changed.

/// For each marked vertex, a chain of the corners at it. A corner is a number: 3 * triangle +
/// place. The chains are in mapped temporary files; only parts that belong to marked vertices are
/// touched. Thread-safety: from one thread.
class VertexStars {
  public:
    /// Throws Error{io}.
    VertexStars(std::uint64_t vertices, std::uint64_t triangles, const ScratchFolder& folder);

    /// Call before the first add().
    void mark(std::uint64_t v) { first_[v] = std::max(first_[v], kEnd); }
    [[nodiscard]] bool is_marked(std::uint64_t v) const { return first_[v] != 0; }

    /// Adds the corner to the chain of `v`; no effect if `v` is not marked.
    void add(std::uint64_t corner, std::uint64_t v) {
        if (is_marked(v)) {
            next_[corner] = first_[v];
            first_[v] = corner + kFirst;
        }
    }
    /// Removes the corner from the chain of `v`; no effect if `v` is not marked. REQUIRES: it was
    /// added.
    void remove(std::uint64_t corner, std::uint64_t v);
    void remove_all(std::uint64_t v) { first_[v] = kEnd; }

    /// All corners at `v`, the last added first. REQUIRES: is_marked(v).
    void corners_of(std::uint64_t v, std::vector<std::uint64_t>& corners) const;

  private:
    static constexpr std::uint64_t kEnd = 1;    ///< 0: not marked
    static constexpr std::uint64_t kFirst = 2;  ///< stands for corner 0
    ScratchFile first_file_;
    ScratchFile next_file_;
    std::span<std::uint64_t> first_;
    std::span<std::uint64_t> next_;
};

// Whether an edge of a surface can be collapsed without changing its topology.
//
// Source: T. Dey, H. Edelsbrunner, S. Guha, D. Nekhayev, "Topology preserving edge contraction"
// (1999): the condition on the links of the edge and its ends. A surface with borders is treated as
// closed, by an additional vertex that is connected to all border edges.

/// The edges opposite a vertex in the triangles around it, in the direction of the triangles.
using LinkEdges = std::vector<std::array<std::uint64_t, 2>>;

/// The additional vertex.
inline constexpr std::uint64_t kBeyondBorder = std::numeric_limits<std::uint64_t>::max();

/// Sorts the link of a vertex. If it is a path from border to border, closes it by two edges over
/// kBeyondBorder. Returns false if the result is not a single ring: the surface is not a manifold
/// at the vertex, or two triangles have the same corners.
bool close_link(LinkEdges& link);

/// Whether the edge between the vertices of two closed links can be collapsed. REQUIRES: the edge
/// exists.
bool may_collapse(const LinkEdges& a, const LinkEdges& b);

}  // namespace isonest::detail
