// z = A w on an implicit grid, with the mass and stiffness matrices of linear elements, which are
// not stored.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 7: z = 0; then for each leaf the local matrix,
// the local product with w at its vertices, and the update of z there.
//
// The order of additions at each node is fixed: first the leaves larger than a block, then blocks
// by the parities of their coordinates. Blocks of equal parities share no node, so they may run in
// parallel, and the result is the same for any number of threads.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/finite_elements/active_nodes.h"
#include "query/finite_elements/finest_cells.h"
#include "query/finite_elements/grid_blocks.h"
#include "store/base/workers.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

// An assembled stiffness matrix of an implicit grid, as weights of the edges, block by block.
//
// Source: the rows of the stiffness matrix of linear functions have sum 0; see block_product.h. Y.
// Saad, "Iterative methods for sparse linear systems" (2003), section 3.4, on sparse storage: this
// is the coordinate scheme, for one triangle of a symmetric matrix, with numbers local to a block.

/// One block's contribution to the matrix. Its nodes are numbered in the order of the grid's
/// numbers.
template <class Real>
struct EdgeWeights {
    struct Ends {
        std::uint16_t from;
        std::uint16_t to;
    };
    std::vector<std::uint64_t> row_first;  ///< for each run of nodes, the grid's number of its
                                           ///< first
    std::vector<std::uint16_t> row_count;  ///< number of nodes in each run
    std::vector<Ends> ends;
    std::vector<Real> weight;

    void clear() {
        row_first.clear();
        row_count.clear();
        ends.clear();
        weight.clear();
    }
    [[nodiscard]] std::uint64_t heap() const {
        return row_first.size() * sizeof(std::uint64_t) + row_count.size() * sizeof(std::uint16_t) +
               ends.size() * sizeof(Ends) + weight.size() * sizeof(Real);
    }
};

/// See the top of this file. Made by GridOperator::assemble(). Thread-safety: one thread.
template <class Real>
class GridMatrix {
  public:
    /// out = diagonal * w + B w. All spans have one number per node of the grid; the result is the
    /// same for any number of threads. Uses the threads of the caller's arena.
    void multiply(std::span<const Real> diagonal, std::span<const Real> w,
                  std::span<Real> out) const;
    /// Size in bytes.
    [[nodiscard]] std::uint64_t heap() const;
    /// Number of entries of one triangle; those shared by two blocks count twice.
    [[nodiscard]] std::uint64_t edges() const;

  private:
    template <class>
    friend class GridOperator;
    struct CoarseEdge {
        std::uint64_t from;
        std::uint64_t to;
        Real weight;
    };

    std::vector<CoarseEdge> coarse_;  ///< of leaves larger than a block
    /// By the parities of the blocks' positions: blocks of one group share no node.
    std::array<std::vector<EdgeWeights<Real>>, 8> blocks_;
};

extern template class GridMatrix<float>;
extern template class GridMatrix<double>;

template <class Real, int D>
struct BlockCommon;

/// a(E), one for each element: 1, or g(|grad s|) with g(t) = 1 / (1 + (t / lambda)^2) for a
/// function s at the active nodes (P. Perona, J. Malik, "Scale-space and edge detection using
/// anisotropic diffusion", IEEE PAMI 12, 1990).
template <class Real>
struct Coefficient {
    std::span<const Real> of = {};  ///< s; empty: a(E) = 1
    double lambda = 1;              ///< > 0, values per world unit
};

/// Functions are given by their values at the active nodes, in the order of NodeSet::number(). Uses
/// 16 bytes for each block of 16^3 cells (64^2 in a plane), and arrays of a block for each thread.
/// Thread-safety: one thread; the nodes must outlive it. REQUIRES: lattice.dimension() > 0; the set
/// was made by active_nodes().
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
    /// The diagonal of the lumped mass matrix: the sums of M's rows. The diagonal of M itself is 2
    /// / (d + 2) times as large, in d dimensions.
    void lumped_mass(std::span<Real> out);
    /// scale * B as a matrix that multiplies faster where elements of many levels are adjacent, and
    /// the diagonals: of the lumped mass matrix, and of scale * B. Nothing, with undefined
    /// diagonals, if it would need more than `most` bytes.
    std::optional<GridMatrix<Real>> assemble(const Coefficient<Real>& a, double scale,
                                             std::span<Real> mass, std::span<Real> diagonal,
                                             std::uint64_t most);

    [[nodiscard]] const NodeSet& nodes() const { return nodes_; }
    [[nodiscard]] Workers& workers() { return workers_; }

  private:
    struct Input;

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
    template <int D>
    BlockCommon<Real, D> common(const Input& input) const;
    template <ElementWork Work>
    void dispatch_run(const Input& input);

    Lattice lattice_;
    Double3 spacing_;
    const NodeSet& nodes_;
    Workers workers_;
    GridBlocks blocks_;
};

extern template class GridOperator<float>;
extern template class GridOperator<double>;

}  // namespace isonest::detail
