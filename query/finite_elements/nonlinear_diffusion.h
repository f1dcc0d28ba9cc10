// Smoothing that keeps edges: nonlinear diffusion on adaptive grids.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 7 and Figure 6; the equation is that of Perona
// and Malik (IEEE PAMI 12, 1990) with the gradient of a smoothed function after F. Catte, P.-L.
// Lions, J.-M. Morel, T. Coll ("Image selective smoothing and edge detection by nonlinear
// diffusion", SIAM J. Numer. Anal. 29, 1992).
//
// A step solves (M + tau B(u)) u' = M u, M the lumped mass matrix and B(u) the stiffness matrix
// with a(E) = g(|grad (G_sigma * u)|), g(s) = 1 / (1 + (s / lambda)^2), on the grid whose nodes
// have eta_{1,infinity} of u not below a threshold.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/finite_elements/node_set.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

struct DiffusionOptions {
    double tau = 1;        ///< time of a step, squares of world units; > 0
    double lambda = 1;     ///< gradients well above keep their edge; values per world unit; > 0
    double sigma = 0;      ///< of the Gaussian, world units; >= 0
    double threshold = 0;  ///< nodes below are not refined; values per world unit; 0 = all are
    /// The residual, relative to that of the mean value in place of the solution.
    double tolerance = 1e-6;
    int most_iterations = 1000;  ///< of a step
    int threads = 0;             ///< 0 = all
};

/// What one step did.
struct DiffusionStep {
    std::uint64_t unknowns = 0;  ///< active nodes
    int iterations = 0;
    double residual = 0;  ///< as DiffusionOptions::tolerance
    double mean = 0;      ///< of the grid's function over the volume, which a step does not change
    double variance = 0;  ///< of its lumped values, which a step does not raise
    double least = 0;     ///< of its values
    double largest = 0;
};

/// A function on a lattice that is smoothed step by step, the same for any number of threads.
/// Thread-safety: one thread.
class NonlinearDiffusion {
  public:
    /// `values`: of all nodes, x fastest. REQUIRES: they are finite and as many as the lattice has
    /// nodes; lattice.dimension() > 0; options as they say.
    NonlinearDiffusion(const Lattice& lattice, const Double3& spacing, std::vector<float> values,
                       const DiffusionOptions& options);

    /// Throws Error{limit, cancelled}, after which there are no values.
    DiffusionStep step(Progress& progress);
    [[nodiscard]] std::span<const float> values() const { return values_; }
    /// The grid that a step from here would take.
    [[nodiscard]] NodeSet grid(Progress& progress) const;

    /// Bytes that all this takes at most, the values included.
    static std::uint64_t heap(const Lattice& lattice, const DiffusionOptions& options);

  private:
    Lattice lattice_;
    Double3 spacing_;
    std::vector<float> values_;
    DiffusionOptions options_;
};

}  // namespace isonest::detail
