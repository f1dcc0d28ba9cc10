// Vectors in space; rotation and rounding that are the same on all platforms.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include <isonest/int3.h>
#include <isonest/uneven_axes.h>

namespace isonest::detail {

// The length of a vector by one formula, identical to the last bit with every standard library:
// each rounds std::hypot of three numbers differently.

/// The square root of x^2 + y^2 + z^2, without intermediate overflow.
template <class T>
T hypot3(T x, T y, T z) {
    x = std::abs(x);
    y = std::abs(y);
    z = std::abs(z);
    const T largest = std::max(std::max(x, y), z);
    if (!(largest > 0 && largest < std::numeric_limits<T>::infinity())) {
        return x + y + z;  // 0, infinite, or not a number
    }
    return largest * std::sqrt((x / largest) * (x / largest) + (y / largest) * (y / largest) +
                               (z / largest) * (z / largest));
}

// Products and length of vectors in space.

inline double dot(const Double3& a, const Double3& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

inline Double3 cross(const Double3& a, const Double3& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline double length(const Double3& a) {
    return std::sqrt(dot(a, a));
}

// Normals as stored in meshes: 32-bit floats, of length 1.

/// The vector scaled to length 1; 0 if it is 0 or not finite, so that it gives no direction.
inline std::array<float, 3> unit_normal(Double3 n) {
    // Lengths near the limits of the range of doubles lose bits, or are infinite.
    constexpr double kSmall = 0x1p-900;
    constexpr double kLarge = 0x1p+1000;
    const double largest = std::max({std::fabs(n[0]), std::fabs(n[1]), std::fabs(n[2])});
    if (largest > 0 && (largest < kSmall || largest > kLarge)) {
        for (double& component : n) {
            component *= largest < kSmall ? 0x1p+200 : 0x1p-200;
        }
    }
    std::array<float, 3> unit{};
    const double size = hypot3(n[0], n[1], n[2]);
    if (size > 0 && std::isfinite(size)) {
        for (std::size_t i = 0; i < 3; ++i) {
            unit[i] = static_cast<float>(n[i] / size);
        }
    }
    return unit;
}

/// Whether unit_normal() found no direction.
inline bool has_no_direction(const std::array<float, 3>& normal) {
    return normal[0] == 0 && normal[1] == 0 && normal[2] == 0;
}

// The steps of a lattice whose axes need not be at right angles.
//
// A volume has *own axes*: x along its first axis, y in the plane of the first two, z at right
// angles to both, right-handed. In own axes, the steps from a node to the next ones are the columns
// of an upper triangular matrix with a positive diagonal (the R of a QR decomposition); for a
// lattice at right angles, they are its spacing. Positions, distances, areas and volumes in own
// axes equal those in the world, except for a rotation about the origin.

/// The vector with these components along the directions.
inline Double3 rotated(const Directions& direction, const Double3& v) {
    Double3 out{};
    for (std::size_t w = 0; w < 3; ++w) {
        out[w] = direction[0][w] * v[0] + direction[1][w] * v[1] + direction[2][w] * v[2];
    }
    return out;
}

/// The inverse: the components of a vector along the directions.
inline Double3 unrotated(const Directions& direction, const Double3& v) {
    return {dot(direction[0], v), dot(direction[1], v), dot(direction[2], v)};
}

/// The same about a fixed point.
inline Double3 rotated_about(const Double3& point, const Directions& direction, const Double3& p) {
    const Double3 v = rotated(direction, {p[0] - point[0], p[1] - point[1], p[2] - point[2]});
    return {point[0] + v[0], point[1] + v[1], point[2] + v[2]};
}
inline Double3 unrotated_about(const Double3& point, const Directions& direction,
                               const Double3& p) {
    const Double3 v = unrotated(direction, {p[0] - point[0], p[1] - point[1], p[2] - point[2]});
    return {point[0] + v[0], point[1] + v[1], point[2] + v[2]};
}

/// Whether these are right-handed unit vectors at right angles, up to rounding.
inline bool are_directions(const Directions& d) {
    constexpr double kRounding = 1e-9;
    double most = 0;
    for (std::size_t a = 0; a < 3; ++a) {
        for (std::size_t b = 0; b <= a; ++b) {
            most = std::max(most, std::fabs(dot(d[a], d[b]) - (a == b ? 1 : 0)));
        }
    }
    // A comparison with NaN is false.
    return most <= kRounding && dot(cross(d[0], d[1]), d[2]) > 0;
}

/// The minimum volume spanned by three directions: below it they are nearly in one plane.
inline constexpr double kMinSpanned = 1e-3;

/// Whether these are right-handed unit vectors, up to rounding, that are not in one plane: the
/// directions of a lattice, sheared or not.
inline bool span_space(const Directions& d) {
    constexpr double kRounding = 1e-9;
    double most = 0;
    for (const Double3& axis : d) {
        most = std::max(most, std::fabs(dot(axis, axis) - 1));
    }
    return most <= kRounding && dot(cross(d[0], d[1]), d[2]) >= kMinSpanned;
}

/// The directions of a lattice's own axes: the lattice's directions if they are at right angles,
/// else x along the first one and y in the plane of the first two (Gram-Schmidt). REQUIRES:
/// span_space().
inline Directions own_directions(const Directions& d) {
    if (are_directions(d)) {
        return d;
    }
    const auto unit = [](const Double3& v) {
        const double size = length(v);
        // Adding 0.0 turns -0.0 into 0.0: without rotation the result is exactly kAlongWorld.
        return Double3{v[0] / size + 0.0, v[1] / size + 0.0, v[2] / size + 0.0};
    };
    const double along = dot(d[0], d[1]);
    const Double3 y =
        unit({d[1][0] - along * d[0][0], d[1][1] - along * d[0][1], d[1][2] - along * d[0][2]});
    return {d[0], y, unit(cross(d[0], y))};
}

/// The directions of a lattice, with flat axes (with one node) set at right angles to the others.
/// REQUIRES: span_space().
inline Directions with_flat_axes_across(const Directions& d, const std::array<bool, 3>& is_flat) {
    const auto count = std::count(is_flat.begin(), is_flat.end(), true);
    if (are_directions(d) || count == 0) {
        return d;
    }
    // With one flat axis, that axis; with more, the axis that is not flat.
    const auto first = static_cast<std::size_t>(
        std::find(is_flat.begin(), is_flat.end(), count == 1) - is_flat.begin());
    const std::size_t a = first % 3;
    const std::size_t b = (a + 1) % 3;
    const std::size_t c = (a + 2) % 3;
    Directions out = d;
    if (count == 1) {
        out[a] = cross(d[b], d[c]);
        const double size = length(out[a]);
        out[a] = {out[a][0] / size, out[a][1] / size, out[a][2] / size};
        return out;
    }
    const Directions own = own_directions({d[a], d[b], d[c]});
    out[a] = own[0];
    out[b] = own[1];
    out[c] = own[2];
    return out;
}

/// In world units. Without shear and with even axes, the functions have no rounding errors from
/// them. A lattice with uneven axes is not sheared.
struct LatticeSteps {
    Double3 along{1, 1, 1};  ///< length of each step along the corresponding own axis; uneven: mean
    double y_along_x = 0;    ///< component along own x of the step along y
    double z_along_x = 0;
    double z_along_y = 0;
    const UnevenAxes* uneven = nullptr;  ///< not owned; null: all axes are even

    LatticeSteps() = default;
    /// For a lattice at right angles.
    LatticeSteps(const Double3& spacing) : along(spacing) {}
    /// The same with uneven axes, which must outlive it.
    LatticeSteps(const Double3& spacing, const UnevenAxes* axes) : along(spacing), uneven(axes) {}
    /// REQUIRES: spacing > 0; span_space(direction); `turn` is own_directions(direction).
    LatticeSteps(const Double3& spacing, const Directions& direction, const Directions& turn)
        : along(spacing) {
        if (!are_directions(direction)) {
            for (std::size_t a = 0; a < 3; ++a) {
                along[a] = spacing[a] * dot(direction[a], turn[a]);
            }
            y_along_x = spacing[1] * beside_rounding(dot(direction[1], turn[0]));
            z_along_x = spacing[2] * beside_rounding(dot(direction[2], turn[0]));
            z_along_y = spacing[2] * beside_rounding(dot(direction[2], turn[1]));
        }
    }
    bool operator==(const LatticeSteps& other) const {
        return along == other.along && y_along_x == other.y_along_x &&
               z_along_x == other.z_along_x && z_along_y == other.z_along_y &&
               (uneven == other.uneven ||
                (uneven != nullptr && other.uneven != nullptr && *uneven == *other.uneven));
    }

    [[nodiscard]] bool is_sheared() const {
        return y_along_x != 0 || z_along_x != 0 || z_along_y != 0;
    }
    [[nodiscard]] bool is_uneven(std::size_t axis) const {
        return uneven != nullptr && !uneven->offsets[axis].empty();
    }
    /// Neither sheared nor uneven: each axis has one step, along its own axis.
    [[nodiscard]] bool is_regular() const { return uneven == nullptr && !is_sheared(); }

    /// Without shear: the distance along an axis from node 0 to a place between nodes, linear from
    /// each node to the next and beyond the ends.
    [[nodiscard]] double offset(std::size_t axis, double place) const {
        if (!is_uneven(axis)) {
            return along[axis] * place;
        }
        const std::vector<double>& nodes = uneven->offsets[axis];
        const auto last = static_cast<double>(nodes.size() - 1);
        const double low = std::clamp(std::floor(place), 0.0, last);
        const auto i = static_cast<std::size_t>(low);
        const std::size_t from = std::min(i, nodes.size() - 2);
        return nodes[i] + (place - low) * (nodes[from + 1] - nodes[from]);
    }
    /// Its inverse.
    [[nodiscard]] double place(std::size_t axis, double offset) const {
        if (!is_uneven(axis)) {
            return offset / along[axis];
        }
        const std::vector<double>& nodes = uneven->offsets[axis];
        const auto above = std::upper_bound(nodes.begin() + 1, nodes.end() - 1, offset);
        const auto i = static_cast<std::size_t>(above - nodes.begin()) - 1;
        return static_cast<double>(i) + (offset - nodes[i]) / (nodes[i + 1] - nodes[i]);
    }
    /// The distance between two nodes along an axis, from the first to the second. Along an uneven
    /// axis, nodes beyond the last one are at the last one.
    [[nodiscard]] double between(std::size_t axis, std::int64_t from, std::int64_t to) const {
        if (!is_uneven(axis)) {
            return static_cast<double>(to - from) * along[axis];
        }
        const std::vector<double>& nodes = uneven->offsets[axis];
        const auto last = static_cast<std::int64_t>(nodes.size()) - 1;
        return nodes[static_cast<std::size_t>(std::min(to, last))] -
               nodes[static_cast<std::size_t>(from)];
    }
    /// The vector from node 0 to a place between nodes. With even axes: the vector of this number
    /// of steps along each axis, from anywhere.
    [[nodiscard]] Double3 vector(const Double3& steps) const {
        if (uneven != nullptr) {
            return {offset(0, steps[0]), offset(1, steps[1]), offset(2, steps[2])};
        }
        Double3 v{along[0] * steps[0], along[1] * steps[1], along[2] * steps[2]};
        if (is_sheared()) {
            v[0] += y_along_x * steps[1] + z_along_x * steps[2];
            v[1] += z_along_y * steps[2];
        }
        return v;
    }
    /// Its inverse.
    [[nodiscard]] Double3 steps_of(const Double3& vector) const {
        if (uneven != nullptr) {
            return {place(0, vector[0]), place(1, vector[1]), place(2, vector[2])};
        }
        if (!is_sheared()) {
            return {vector[0] / along[0], vector[1] / along[1], vector[2] / along[2]};
        }
        const double z = vector[2] / along[2];
        const double y = (vector[1] - z_along_y * z) / along[1];
        return {(vector[0] - y_along_x * y - z_along_x * z) / along[0], y, z};
    }
    /// The gradient of a function that changes by `change[a] * along[a]` per step along axis a; for
    /// an uneven axis, `change[a]` is the change per unit of length.
    [[nodiscard]] Double3 gradient(const Double3& change) const {
        if (!is_sheared()) {
            return change;
        }
        const double y = change[1] - y_along_x / along[1] * change[0];
        return {change[0], y,
                change[2] - z_along_x / along[2] * change[0] - z_along_y / along[2] * y};
    }
    /// The change of a function with this gradient per step along each axis. REQUIRES: even axes.
    [[nodiscard]] Double3 changes(const Double3& gradient) const {
        Double3 c{gradient[0] * along[0], gradient[1] * along[1], gradient[2] * along[2]};
        if (is_sheared()) {
            c[1] += gradient[0] * y_along_x;
            c[2] += gradient[0] * z_along_x + gradient[1] * z_along_y;
        }
        return c;
    }
    /// The shortest and the longest step along each axis, as in `along`.
    [[nodiscard]] Double3 min_along() const {
        return extreme_along([](double a, double b) { return std::min(a, b); });
    }
    [[nodiscard]] Double3 max_along() const {
        return extreme_along([](double a, double b) { return std::max(a, b); });
    }
    /// Maximum number of steps along any axis in a vector whose components are at most `most` in
    /// absolute value. `most` must not be negative.
    [[nodiscard]] double max_steps(const Double3& most) const {
        const Double3 least = min_along();
        Double3 inverse{1 / std::fabs(least[0]), 1 / std::fabs(least[1]), 1 / std::fabs(least[2])};
        const double z = most[2] * inverse[2];
        const double y = (most[1] + std::fabs(z_along_y) * z) * inverse[1];
        const double x =
            (most[0] + std::fabs(y_along_x) * y + std::fabs(z_along_x) * z) * inverse[0];
        return std::max({x, y, z});
    }
    /// The largest distance between two corners of a cell.
    [[nodiscard]] double diagonal() const {
        const Double3 largest = max_along();
        double longest = hypot3(largest[0], largest[1], largest[2]);
        for (unsigned signs = 0; is_sheared() && signs < 4; ++signs) {
            const Double3 v =
                vector({1, (signs & 1U) != 0 ? -1.0 : 1.0, (signs & 2U) != 0 ? -1.0 : 1.0});
            longest = std::max(longest, hypot3(v[0], v[1], v[2]));
        }
        return longest;
    }
    /// Lengths of the longest and the shortest step.
    [[nodiscard]] double longest() const {
        const Double3 each = max_along();
        return std::max({each[0], length_of_y(each[1]), length_of_z(each[2])});
    }
    [[nodiscard]] double shortest() const {
        const Double3 each = min_along();
        return std::min({each[0], length_of_y(each[1]), length_of_z(each[2])});
    }

  private:
    /// Without it, the coordinate along a flat axis, at right angles to the others, would vary.
    [[nodiscard]] static double beside_rounding(double cosine) {
        return std::fabs(cosine) > 1e-12 ? cosine : 0;
    }
    [[nodiscard]] double length_of_y(double along_y) const {
        return y_along_x != 0 ? hypot3(y_along_x, along_y, 0.0) : along_y;
    }
    [[nodiscard]] double length_of_z(double along_z) const {
        return z_along_x != 0 || z_along_y != 0 ? hypot3(z_along_x, z_along_y, along_z) : along_z;
    }
    template <class Choose>
    [[nodiscard]] Double3 extreme_along(const Choose& choose) const {
        Double3 chosen = along;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            if (is_uneven(axis)) {
                const std::vector<double>& nodes = uneven->offsets[axis];
                for (std::size_t i = 0; i + 1 < nodes.size(); ++i) {
                    chosen[axis] = choose(chosen[axis], nodes[i + 1] - nodes[i]);
                }
            }
        }
        return chosen;
    }
};

// Differences of doubles, rounded away from zero so that they can be bounds.
//
// Source of the exact remainder of a sum: D. E. Knuth, "The Art of Computer Programming", volume 2,
// 4.2.2, theorem B.

/// The rounding error of a + b rounded to `sum`: exact, except on overflow.
[[gnu::always_inline]] inline double lost_by_sum(double a, double b, double sum) {
    const double of_b = sum - a;
    return (a - (sum - of_b)) + (b - of_b);
}

/// An upper bound of |d + rest|; equal to |d| if the rest adds nothing. `unsure`: maximum error of
/// the rest. NaN in the rest adds nothing.
[[gnu::always_inline]] inline double outward(double d, double rest, double unsure) {
    constexpr double kUp = 1 + 0x1p-51;
    const double size = std::fabs(d);
    const double rest_size = std::fabs(rest);
    const double along = (d < 0 ? -rest : rest) + unsure;
    const bool more = along > 0 || rest_size > size;
    return more ? (size + (rest_size + unsure)) * kUp : size;
}

/// An upper bound of |mid - (a + b) / 2|.
[[gnu::always_inline]] inline double outward_offset(double mid, double a, double b) {
    const double sum = a + b;
    const double half = 0.5 * sum;
    const double d = mid - half;
    return outward(d, lost_by_sum(mid, -half, d) - 0.5 * lost_by_sum(a, b, sum), 0);
}

}  // namespace isonest::detail

// ISONEST_SIMD before a function: it is compiled for several instruction sets, and one is chosen
// when the program starts. The results are the same on all of them, because contraction to fused
// operations is off.

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define ISONEST_SIMD __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define ISONEST_SIMD
#endif
