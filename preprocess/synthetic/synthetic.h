// Volumes with a formula, for trying out, tests and measurements.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <isonest/int3.h>

namespace isonest::detail {

/// A scalar function on the unit cube, sampled on a lattice of nodes().
class SyntheticVolume {
  public:
    SyntheticVolume() = default;
    SyntheticVolume(const SyntheticVolume&) = delete;
    SyntheticVolume& operator=(const SyntheticVolume&) = delete;
    virtual ~SyntheticVolume() = default;
    /// Smallest and largest value the function can take (for scaling to integer types).
    [[nodiscard]] virtual double low() const = 0;
    [[nodiscard]] virtual double high() const = 0;
    /// Values of row y of plane z, x = 0 .. nodes.x - 1. Thread-safe.
    virtual void row(std::int64_t y, std::int64_t z, double* out) const = 0;
};

/// The names that make_synthetic() knows.
const std::vector<std::string>& synthetic_names();

/// Throws Error{invalid_argument} listing the names for an unknown one.
std::unique_ptr<SyntheticVolume> make_synthetic(const std::string& name, const Int3& nodes,
                                                std::uint64_t seed);

}  // namespace isonest::detail
