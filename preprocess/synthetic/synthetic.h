// Volumes with a formula, for trying out, tests and measurements.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/value_type.h>

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

// A time step of the separation of two fluids, as in section 6 of the paper.

/// The concentration u, -1 to 1, of the Cahn-Hilliard equation
///   du/dt = laplace(u^3 - u - laplace(u) / 2)
/// after 200 units of time from small noise, on a square with mirrored borders, one node per unit;
/// every plane of a volume is the same. Made at once in memory (24 bytes per node of a plane), by
/// explicit Euler steps. Throws Error{limit} beyond 4096 x 4096 nodes.
std::unique_ptr<SyntheticVolume> make_cahn_hilliard(const Int3& nodes, std::uint64_t seed);

// Writes synthetic volumes of any size.

struct MakeVolumeOptions {
    std::string name = "bucky";  ///< see synthetic_names()
    Int3 nodes{129, 129, 129};
    ValueType type = ValueType::f32;  ///< integers: the function's range on the type's range
    std::uint64_t seed = 1;
    int threads = 0;  ///< 0 = all cores
    bool force = false;
};

/// Evaluates the function plane by plane; memory does not grow with the number of planes.
/// Throws Error{invalid_argument, unsupported, io, cancelled}.
void make_volume(const std::filesystem::path& path, const MakeVolumeOptions& options,
                 Progress& progress);

}  // namespace isonest::detail
