// Smoothing that preserves edges: nonlinear diffusion on adaptive grids.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 7 and Figure 6; the equation is that of Perona
// and Malik (IEEE PAMI 12, 1990) with the gradient of a smoothed function after F. Catte, P.-L.
// Lions, J.-M. Morel, T. Coll ("Image selective smoothing and edge detection by nonlinear
// diffusion", SIAM J. Numer. Anal. 29, 1992).
//
// A step solves (M + tau B(u)) u' = M u, where M is the lumped mass matrix and B(u) the stiffness
// matrix with a(E) = g(|grad (G_sigma * u)|), g(s) = 1 / (1 + (s / lambda)^2), on the grid of the
// nodes where eta_{1,infinity} of u is not below a threshold.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/finite_elements/active_nodes.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

// G_sigma * u on a lattice in memory.

/// Convolves with a Gaussian of standard deviation sigma (world units), sampled at the nodes and
/// truncated at four sigma, axis by axis; at the border the function is mirrored at the last node.
/// Constants are preserved. sigma = 0: no effect. Uses the threads of the caller's arena.
void smooth_gaussian(std::span<float> values, const Int3& nodes, const Double3& spacing,
                     double sigma);

// Conversion between functions on a lattice and functions on an implicit grid.
//
// Source: Gerstner, Rumpf, Weikard (2000), sections 3 and 7: the grid's function at a node that is
// not active is the mean of the two ends of its refinement edge.

/// Extracts the values at the active nodes from those at all nodes, x fastest. Both functions use
/// the threads of the caller's arena.
void restrict_to(const NodeSet& set, std::span<const float> all, std::span<float> active);

/// The function with these values at the active nodes, at all nodes of the lattice. REQUIRES: the
/// set was made by active_nodes().
template <class Real>
void prolong(const Lattice& lattice, const NodeSet& set, std::span<const Real> active,
             std::span<Real> all);

struct DiffusionOptions {
    double tau = 1;        ///< time of a step, squared world units; > 0
    double lambda = 1;     ///< edges with gradients well above are preserved; values per world
                           ///< unit; > 0
    double sigma = 0;      ///< standard deviation of the Gaussian, world units; >= 0
    double threshold = 0;  ///< nodes below are not refined; values per world unit; 0 = refine all
    /// The residual, relative to that of the mean value as a solution.
    double tolerance = 1e-6;
    int max_iterations = 1000;  ///< per step
    int threads = 0;            ///< 0 = all
};

/// Result of one step.
struct DiffusionStep {
    std::uint64_t unknowns = 0;  ///< active nodes
    int iterations = 0;
    double residual = 0;  ///< as DiffusionOptions::tolerance
    double mean = 0;      ///< of the grid's function over the volume; preserved by a step
    double variance = 0;  ///< of its lumped values; not increased by a step
    double least = 0;     ///< smallest value
    double largest = 0;
};

/// A function on a lattice that is smoothed step by step; the result is the same for any number of
/// threads. Thread-safety: one thread.
class NonlinearDiffusion {
  public:
    /// `values`: of all nodes, x fastest. REQUIRES: they are finite, one per node of the lattice;
    /// lattice.dimension() > 0; options in the ranges given there.
    NonlinearDiffusion(const Lattice& lattice, const Double3& spacing, std::vector<float> values,
                       const DiffusionOptions& options);

    /// Throws Error{limit, cancelled}; afterwards there are no values.
    DiffusionStep step(Progress& progress);
    [[nodiscard]] std::span<const float> values() const { return values_; }
    /// The grid that the next step would use.
    [[nodiscard]] NodeSet grid(Progress& progress) const;

    /// Maximum total size in bytes, including the values.
    static std::uint64_t heap(const Lattice& lattice, const DiffusionOptions& options);

  private:
    Lattice lattice_;
    Double3 spacing_;
    std::vector<float> values_;
    DiffusionOptions options_;
};

}  // namespace isonest::detail
