// Bounds on the values within each cube of the coarser levels.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5: beta_0 excludes an element that the
// isosurface cannot reach. A bound on the distance from the element's linear function holds on both
// sides of it; where a few extremes lie far on one side, what is there itself excludes more.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include <isonest/value_type.h>

#include "store/lattice/lattice.h"

namespace isonest::detail {

/// The finest of the levels whose cubes have one: cubes of 8^3 finest cells.
inline constexpr int kFirstRangeLevel = 3;
inline constexpr std::int64_t kFirstRangeEdge = std::int64_t{1} << kFirstRangeLevel;

/// The smallest and the largest value at the nodes of a closed cube, NaN left out; (+inf, -inf)
/// without any.
struct CubeRange {
    float low = std::numeric_limits<float>::infinity();
    float high = -std::numeric_limits<float>::infinity();

    bool operator==(const CubeRange&) const = default;
    /// Whether there can be values below the isovalue and values not below it.
    [[nodiscard]] bool may_hold(double iso) const {
        return static_cast<double>(low) < iso && static_cast<double>(high) >= iso;
    }
    void include(const CubeRange& other) {
        low = other.low < low ? other.low : low;
        high = other.high > high ? other.high : high;
    }
};
static_assert(sizeof(CubeRange) == 8);

/// The narrowest that holds both numbers.
inline CubeRange cube_range_around(double low, double high) {
    CubeRange range{static_cast<float>(low), static_cast<float>(high)};
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    if (static_cast<double>(range.low) > low) {
        range.low = std::nextafter(range.low, -kInfinity);
    }
    if (static_cast<double>(range.high) < high) {
        range.high = std::nextafter(range.high, kInfinity);
    }
    return range;
}

/// As what both numbers are stored: the values' own type where binary32 holds all of its numbers,
/// else binary32, rounded outward.
inline ValueType cube_range_type(ValueType values) {
    return size_of(values) <= 2 ? values : ValueType::f32;
}
inline std::size_t cube_range_bytes(ValueType values) {
    return 2 * size_of(cube_range_type(values));
}

/// Whether the cubes of a level have ranges.
inline bool has_cube_ranges(const Lattice& lattice, int level) {
    return lattice.dimension() == 3 && level >= kFirstRangeLevel && level <= lattice.top();
}

}  // namespace isonest::detail
