// Smoothing that preserves edges: nonlinear diffusion on adaptive grids.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 7 and Figure 6; the equation is that of Perona
// and Malik (IEEE PAMI 12, 1990) with the gradient of a smoothed function after F. Catte, P.-L.
// Lions, J.-M. Morel, T. Coll ("Image selective smoothing and edge detection by nonlinear
// diffusion", SIAM J. Numer. Anal. 29, 1992).
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/store.h>
#include <isonest/volume_source.h>

namespace isonest {
namespace detail {
class NonlinearDiffusion;
class VolumeValues;
}  // namespace detail

struct SmoothOptions {
    double tau = 1;     ///< time of a step, squared world units; > 0
    double lambda = 1;  ///< edges with gradients well above are preserved; values per world
                        ///< unit; > 0
    /// Standard deviation, in world units, of the Gaussian that smooths the function whose gradient
    /// is compared with lambda; >= 0. Nothing: the smallest spacing of an axis that is not flat.
    std::optional<double> sigma = {};
    double threshold = 0;  ///< nodes below are not refined; values per world unit; 0 = refine all
    /// The residual, relative to that of the mean value as a solution.
    double tolerance = 1e-6;
    int max_iterations = 1000;                       ///< per step
    std::uint64_t memory = std::uint64_t{1} << 30U;  ///< maximum bytes of heap
    int threads = 0;                                 ///< 0 = all cores
};

/// Result of one step.
struct SmoothStep {
    std::uint64_t unknowns = 0;  ///< nodes of the step's grid
    int iterations = 0;
    double residual = 0;  ///< as SmoothOptions::tolerance
    double mean = 0;      ///< of the grid's function over the volume; preserved by a step
    double variance = 0;  ///< of its lumped values; not increased by a step
    double least = 0;     ///< smallest value
    double largest = 0;
};

/// A volume in memory that is smoothed step by step. Without edges, N steps smooth like a Gaussian
/// of standard deviation sqrt(2 N tau). A step solves (M + tau B(u)) u' = M u, where M is the
/// lumped mass matrix and B(u) the stiffness matrix with the coefficient g(|grad (G_sigma * u)|),
/// g(s) = 1 / (1 + (s / lambda)^2), on the grid of the nodes where eta_{1,infinity} of u is not
/// below the threshold. The values do not depend on the threads. Must not be used after being moved
/// from. Thread-safety: one thread.
class Smoothing {
  public:
    /// Reads all values, rounded to float32. Throws Error{invalid_argument} for an option out of
    /// range, Error{unsupported} if there is only one node, the axes are not at right angles, the
    /// values are labels of 64 bits, or one is missing or too large, Error{limit} if the unknowns
    /// do not fit into the memory (28 bytes per node, 52 with a threshold), and what reading
    /// throws.
    explicit Smoothing(const Store& store, const SmoothOptions& options = {},
                       Progress& progress = silent_progress());
    explicit Smoothing(VolumeSource& volume, const SmoothOptions& options = {},
                       Progress& progress = silent_progress());
    Smoothing(Smoothing&& other) noexcept;
    Smoothing& operator=(Smoothing&& other) noexcept;
    Smoothing(const Smoothing&) = delete;
    Smoothing& operator=(const Smoothing&) = delete;
    ~Smoothing();

    /// Throws Error{limit, cancelled}; afterwards there are no values.
    SmoothStep step(Progress& progress = silent_progress());
    /// The values of all nodes, x fastest.
    [[nodiscard]] std::span<const float> values() const;
    /// The grid that the next step would use: 1 for its nodes, 0 for others, x fastest.
    [[nodiscard]] std::vector<std::uint8_t> grid(Progress& progress = silent_progress()) const;
    /// Nodes along x, y and z.
    [[nodiscard]] Int3 nodes() const;
    /// With the standard deviation that is used.
    [[nodiscard]] const SmoothOptions& options() const;

    /// For internal use by the library.
    [[nodiscard]] const detail::NonlinearDiffusion& diffusion() const { return *diffusion_; }

  private:
    Smoothing(const detail::VolumeValues& input, const SmoothOptions& options, Progress& progress);
    std::unique_ptr<detail::NonlinearDiffusion> diffusion_;
};

}  // namespace isonest
