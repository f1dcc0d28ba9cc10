// z = A w on an implicit grid: the mass and stiffness matrices of linear elements, never stored.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 7: z = 0; then for each leaf the local matrix,
// the local product with w at its vertices, and z at them updated.
//
// The order of additions at each node is fixed: first the leaves larger than a block, then blocks
// by the parities of their coordinates. Blocks of equal parities share no node, so they may run
// side by side, and the result is the same for any number of threads.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/finite_elements/edge_weights.h"
#include "query/finite_elements/finest_cells.h"
#include "query/finite_elements/node_set.h"
#include "store/base/workers.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

template <class Real, int D>
struct BlockCommon;

/// a(E), one for each element: 1, or g(|grad s|) with g(t) = 1 / (1 + (t / lambda)^2) of a function
/// s at the active nodes (P. Perona, J. Malik, "Scale-space and edge detection using anisotropic
/// diffusion", IEEE PAMI 12, 1990).
template <class Real>
struct Coefficient {
    std::span<const Real> of = {};  ///< s; empty: a(E) = 1
    double lambda = 1;              ///< > 0, values per world unit
};

/// Functions are given by their values at the active nodes, by NodeSet::number(). Holds 16 bytes
/// for each block of 16^3 cells (64^2 in a plane), and for each thread arrays of a block.
/// Thread-safety: one thread; the nodes have to stay. REQUIRES: lattice.dimension() > 0; the set is
/// one that active_nodes() made.
template <class Real>
class GridOperator {
  public:
    /// `threads`: 0 = all. Throws Error{limit}.
    GridOperator(const Lattice& lattice, const Double3& spacing, const NodeSet& nodes, int threads);

    /// out = scale * B w, B_ij = sum of |E| a(E) grad phi_i . grad phi_j.
    void stiffness(const Coefficient<Real>& a, double scale, std::span<const Real> w,
                   std::span<Real> out);
    /// The diagonal of scale * B.
    void stiffness_diagonal(const Coefficient<Real>& a, double scale, std::span<Real> out);
    /// out = M w, the consistent mass matrix.
    void mass(std::span<const Real> w, std::span<Real> out);
    /// The diagonal of the lumped mass matrix: the sums of M's rows. That of M itself is 2 / (d +
    /// 2) times as large, in d dimensions.
    void lumped_mass(std::span<Real> out);
    /// scale * B as a matrix that multiplies faster where elements of many levels lie side by
    /// side, and the diagonals: the lumped mass matrix, and that of scale * B. Nothing, with
    /// diagonals that mean nothing, if it would hold more than `most` bytes.
    std::optional<GridMatrix<Real>> assemble(const Coefficient<Real>& a, double scale,
                                             std::span<Real> mass, std::span<Real> diagonal,
                                             std::uint64_t most);

    [[nodiscard]] const NodeSet& nodes() const { return nodes_; }
    [[nodiscard]] Workers& workers() { return workers_; }

  private:
    struct Block {
        std::array<std::uint32_t, 3> corner;
        std::uint32_t elements;  ///< bits of the walks, in the order of coarsest_elements()
    };
    struct Input;

    template <int D>
    void find_blocks();
    template <ElementWork Work, bool HasCoefficient, int D>
    void run(const Input& input);
    template <ElementWork Work, bool HasCoefficient, int D>
    void add_coarse(const Input& input);
    template <bool HasCoefficient, int D>
    std::optional<GridMatrix<Real>> assemble(const Input& input, std::span<Real> mass,
                                             std::uint64_t most);
    template <bool HasCoefficient, int D>
    void add_coarse_weights(const Input& input, std::span<Real> mass, GridMatrix<Real>& matrix);
    template <class F>
    auto with_dimension(const F& f);
    template <int D, class Action>
    void for_coarse_leaves(const Action& action);
    template <int D>
    BlockCommon<Real, D> common(const Input& input) const;
    template <ElementWork Work>
    void dispatch_run(const Input& input);

    Lattice lattice_;
    Double3 spacing_;
    const NodeSet& nodes_;
    Workers workers_;
    int block_level_ = 0;
    std::array<std::vector<Block>, 8> blocks_;  ///< by the parities of their coordinates
};

extern template class GridOperator<float>;

}  // namespace isonest::detail
