// Small deterministic volumes of any size for the tests: the same numbers on every machine but for
// the last bits of sin and cos.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>
#include <type_traits>
#include <vector>

#include "store/int3.h"

namespace isonest::oracle {

/// Values of all nodes, x fastest.
struct Volume {
    Int3 nodes;
    std::vector<double> values;
};

inline Volume sampled(const Int3& nodes, const std::function<double(const Int3&)>& f) {
    Volume v{nodes, {}};
    v.values.reserve(static_cast<std::size_t>(nodes.product()));
    for (std::int64_t i = 0; i < nodes.product(); ++i) {
        v.values.push_back(f(nodes.unlinear(i)));
    }
    return v;
}

/// A well mixed function of the coordinates (the finaliser of splitmix64 over each).
inline std::uint64_t hash(const Int3& p, std::uint64_t seed) {
    std::uint64_t h = seed;
    for (int axis = 0; axis < 3; ++axis) {
        h += static_cast<std::uint64_t>(p[axis]) + 0x9E3779B97F4A7C15ULL;
        h = (h ^ (h >> 30U)) * 0xBF58476D1CE4E5B9ULL;
        h = (h ^ (h >> 27U)) * 0x94D049BB133111EBULL;
        h ^= h >> 31U;
    }
    return h;
}

/// Independent at every node, uniform in [0, 1), multiples of 2^-24 (exact in binary32).
inline Volume noise(const Int3& nodes, std::uint64_t seed = 1) {
    return sampled(
        nodes, [=](const Int3& p) { return static_cast<double>(hash(p, seed) >> 40U) * 0x1p-24; });
}

/// A few waves per 33 nodes, values in [-2.1, 2.1].
inline Volume smooth(const Int3& nodes) {
    return sampled(nodes, [](const Int3& p) {
        const auto x = static_cast<double>(p.x);
        const auto y = static_cast<double>(p.y);
        const auto z = static_cast<double>(p.z);
        return std::sin(0.31 * x) * std::cos(0.23 * y) + std::sin(0.19 * z + 0.1 * x) +
               0.1 * std::sin(0.05 * x * y);
    });
}

inline Volume constant(const Int3& nodes, double value) {
    return sampled(nodes, [=](const Int3&) { return value; });
}

/// Linear: every indicator is 0 (but for tetrahedra that reach out of the volume).
inline Volume ramp(const Int3& nodes, const Double3& slope = {1, 2, -0.5}, double at_origin = 0) {
    return sampled(nodes, [=](const Int3& p) {
        return at_origin + slope[0] * static_cast<double>(p.x) +
               slope[1] * static_cast<double>(p.y) + slope[2] * static_cast<double>(p.z);
    });
}

/// Integers 0 .. levels - 1 in wide flat regions: isovalues that are integers hit many nodes
/// exactly.
inline Volume plateaus(const Int3& nodes, int levels = 4) {
    Volume v = smooth(nodes);
    for (double& value : v.values) {
        value = std::floor((value + 2.1) / 4.2 * levels);
    }
    return v;
}

/// Integers 0 .. levels - 1, independent at every node: exact hits in every configuration.
inline Volume few_values(const Int3& nodes, int levels = 5, std::uint64_t seed = 1) {
    return sampled(nodes, [=](const Int3& p) {
        return static_cast<double>(hash(p, seed) % static_cast<std::uint64_t>(levels));
    });
}

/// The signal of S. Marschner and R. Lobb, "An evaluation of reconstruction filters for volume
/// rendering" (1994), on [-1, 1]^3 with f_M = 6, alpha = 0.25; values in [0, 1].
inline Volume marschner_lobb(const Int3& nodes) {
    return sampled(nodes, [=](const Int3& p) {
        Double3 q{};
        for (int axis = 0; axis < 3; ++axis) {
            q[static_cast<std::size_t>(axis)] =
                nodes[axis] < 2
                    ? 0
                    : 2 * static_cast<double>(p[axis]) / static_cast<double>(nodes[axis] - 1) - 1;
        }
        constexpr double kPi = std::numbers::pi;
        const double r = std::hypot(q[0], q[1]);
        const double rho = std::cos(12 * kPi * std::cos(kPi * r / 2));
        return (1 - std::sin(kPi * q[2] / 2) + 0.25 * (1 + rho)) / 2.5;
    });
}

/// Replaces about one node in `every` by NaN, +inf or -inf.
inline Volume with_missing(Volume v, std::uint64_t every = 50, std::uint64_t seed = 3) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    const std::array<double, 3> kinds{std::numeric_limits<double>::quiet_NaN(), kInfinity,
                                      -kInfinity};
    for (std::int64_t i = 0; i < v.nodes.product(); ++i) {
        const std::uint64_t h = hash(v.nodes.unlinear(i), seed);
        if (h % every == 0) {
            v.values[static_cast<std::size_t>(i)] = kinds[(h >> 32U) % 3];
        }
    }
    return v;
}

/// The least and the greatest value of T, their neighbours and 0, mixed.
template <class T>
Volume extremes(const Int3& nodes, std::uint64_t seed = 5) {
    static_assert(std::numeric_limits<T>::digits <= 53, "every value must be a double");
    using Limits = std::numeric_limits<T>;
    std::array<double, 5> values{};
    if constexpr (std::is_integral_v<T>) {
        values = {static_cast<double>(Limits::lowest()), static_cast<double>(Limits::lowest()) + 1,
                  0, static_cast<double>(Limits::max()) - 1, static_cast<double>(Limits::max())};
    } else {
        values = {static_cast<double>(Limits::lowest()), -static_cast<double>(Limits::denorm_min()),
                  0, static_cast<double>(Limits::min()), static_cast<double>(Limits::max())};
    }
    return sampled(nodes, [=](const Int3& p) { return values[hash(p, seed) % values.size()]; });
}

/// As T: floating point by rounding; integers by stretching the values' range over all of T's.
/// REQUIRES: all values finite if T is an integer.
template <class T>
std::vector<T> converted(const Volume& v) {
    std::vector<T> out;
    out.reserve(v.values.size());
    if constexpr (std::is_integral_v<T>) {
        static_assert(std::numeric_limits<T>::digits <= 53, "every value must be a double");
        constexpr auto kLow = static_cast<double>(std::numeric_limits<T>::lowest());
        constexpr auto kHigh = static_cast<double>(std::numeric_limits<T>::max());
        double low = std::numeric_limits<double>::infinity();
        double high = -low;
        for (const double value : v.values) {
            low = std::min(low, value);
            high = std::max(high, value);
        }
        const double scale = high > low ? (kHigh - kLow) / (high - low) : 0;
        for (const double value : v.values) {
            out.push_back(
                static_cast<T>(std::min(kHigh, std::floor(kLow + (value - low) * scale))));
        }
    } else {
        for (const double value : v.values) {
            out.push_back(static_cast<T>(value));
        }
    }
    return out;
}

}  // namespace isonest::oracle
