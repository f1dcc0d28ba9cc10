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
#include <isonest/smooth.h>

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

/// A function on a lattice that is smoothed step by step; the result is the same for any number of
/// threads. Thread-safety: one thread.
class NonlinearDiffusion {
  public:
    /// `values`: of all nodes, x fastest. REQUIRES: they are finite, one per node of the lattice;
    /// lattice.dimension() > 0; options in the ranges given there. options.memory is not used: see
    /// heap().
    NonlinearDiffusion(const Lattice& lattice, const Double3& spacing, std::vector<float> values,
                       const SmoothOptions& options);

    /// Throws Error{limit, cancelled}, after which the object holds no values.
    SmoothStep step(Progress& progress);
    [[nodiscard]] std::span<const float> values() const { return values_; }
    [[nodiscard]] const Lattice& lattice() const { return lattice_; }
    /// With the standard deviation that is used.
    [[nodiscard]] const SmoothOptions& options() const { return options_; }
    /// The grid that the next step would use.
    [[nodiscard]] NodeSet grid(Progress& progress) const;

    /// Maximum total size in bytes, including the values.
    static std::uint64_t heap(const Lattice& lattice, const SmoothOptions& options);

  private:
    Lattice lattice_;
    Double3 spacing_;
    std::vector<float> values_;
    SmoothOptions options_;
};

}  // namespace isonest::detail
