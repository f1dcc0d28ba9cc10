// Integer triples in x, y, z order: lattice coordinates, sizes, chunk coordinates.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

namespace isonest {

/// Three 64-bit integers in the order x, y, z. Arrays in memory and in files are [z][y][x], x
/// fastest; this type never uses that order.
struct Int3 {
    std::int64_t x = 0;
    std::int64_t y = 0;
    std::int64_t z = 0;

    constexpr std::int64_t& operator[](int axis) { return axis == 0 ? x : axis == 1 ? y : z; }
    constexpr std::int64_t operator[](int axis) const { return axis == 0 ? x : axis == 1 ? y : z; }
    constexpr bool operator==(const Int3&) const = default;
    [[nodiscard]] constexpr std::int64_t product() const { return x * y * z; }
    /// Position of element (ix, iy, iz) in an array of this size, x fastest.
    [[nodiscard]] constexpr std::int64_t linear(const Int3& i) const {
        return (i.z * y + i.y) * x + i.x;
    }
    /// Inverse of linear().
    [[nodiscard]] constexpr Int3 unlinear(std::int64_t i) const {
        return {i % x, (i / x) % y, i / (x * y)};
    }
};

constexpr Int3 operator+(const Int3& a, const Int3& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
constexpr Int3 operator-(const Int3& a, const Int3& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
constexpr Int3 operator*(const Int3& a, std::int64_t k) {
    return {a.x * k, a.y * k, a.z * k};
}
constexpr Int3 min(const Int3& a, const Int3& b) {
    return {std::min(a.x, b.x), std::min(a.y, b.y), std::min(a.z, b.z)};
}
constexpr Int3 max(const Int3& a, const Int3& b) {
    return {std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)};
}
constexpr std::int64_t ceil_div(std::int64_t a, std::int64_t b) {
    return (a + b - 1) / b;
}
constexpr Int3 ceil_div(const Int3& a, const Int3& b) {
    return {ceil_div(a.x, b.x), ceil_div(a.y, b.y), ceil_div(a.z, b.z)};
}

using Double3 = std::array<double, 3>;  ///< x, y, z in world units

/// World directions of the axes x, y and z: unit vectors, right-handed. They are not at right
/// angles in a sheared lattice.
using Directions = std::array<Double3, 3>;
inline constexpr Directions kAlongWorld{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

}  // namespace isonest
