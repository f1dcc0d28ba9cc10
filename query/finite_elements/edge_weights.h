// An assembled stiffness matrix of an implicit grid, as weights of the edges, block by block.
//
// Source: linear functions' stiffness matrix has rows of sum 0; see block_weights.h. Y. Saad,
// "Iterative methods for sparse linear systems" (2003), section 3.4, on sparse storage: this is the
// coordinate scheme, of one triangle of a symmetric matrix, with numbers that are local to a block.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "store/base/workers.h"

namespace isonest::detail {

/// What one block adds to the matrix. Its nodes are numbered in the order of the grid's numbers.
template <class Real>
struct EdgeWeights {
    struct Ends {
        std::uint16_t from;
        std::uint16_t to;
    };
    std::vector<std::uint64_t> row_first;  ///< of each run of nodes, the grid's number of its first
    std::vector<std::uint16_t> row_count;  ///< and how many there are
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
    /// out = diagonal * w + B w. All of as many numbers as the grid has nodes; the same for any
    /// number of threads. Uses the threads of the arena that calls.
    void multiply(std::span<const Real> diagonal, std::span<const Real> w,
                  std::span<Real> out) const;
    /// Bytes that it holds.
    [[nodiscard]] std::uint64_t heap() const;
    /// Entries of one triangle, those that two blocks share counted twice.
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
    /// By the parities of the blocks' places: blocks of one group share no node.
    std::array<std::vector<EdgeWeights<Real>>, 8> blocks_;
};

extern template class GridMatrix<float>;
extern template class GridMatrix<double>;

}  // namespace isonest::detail
