// AdaptTraverse on nested cells: which ones are visited, and by which thread.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 2, with cells that are refined into 2^D in place
// of simplices that are bisected.
#pragma once

#include <cstdint>
#include <vector>

#include <isonest/int3.h>

#include "query/march/clip.h"
#include "query/traverse/cube_share.h"
#include "query/view/topology.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// The cell of `level` whose low corner is `at`, in cells.
struct Cell {
    int level;
    Int3 at;

    [[nodiscard]] std::int64_t edge() const { return std::int64_t{1} << level; }
    [[nodiscard]] Int3 low() const { return at * edge(); }
};

/// One thread's walk. A worker's refines(cell, where), `where` being how the cell lies to the box,
/// decides whether a cell is refined, and takes it if it is a leaf. D is 3, or 2 where z is flat.
template <int D>
class CellWalk {
  public:
    /// Of the subtrees only those that begin in `share` are walked.
    CellWalk(const Lattice& lattice, const ClipBox& box, const CubeShare& share = {})
        : lattice_(lattice), box_(box), share_(share) {}

    /// All cells of the level, from the coarsest on; those of `level_left` are left, unvisited, to
    /// others.
    template <class Worker>
    void above(int level_left, Worker& worker, std::vector<Cell>& left) {
        level_left_ = level_left;
        is_for_others_ = !share_.owns(0, {0, 0, 0});
        const Int3 roots = lattice_.elements_at(lattice_.top());
        for (std::int64_t i = 0; i < roots.product(); ++i) {
            visit({lattice_.top(), roots.unlinear(i)}, worker, &left);
        }
        is_for_others_ = false;
    }
    template <class Worker>
    void subtree(const Cell& cell, Worker& worker) {
        if (share_.owns(cell.level, cell.at)) {
            visit(cell, worker, nullptr);
        }
    }
    [[nodiscard]] std::uint64_t visited() const { return visited_; }
    /// Whether the cells that are visited are another rank's, which takes their leaves: the coarse
    /// ones are those of the rank that has the first cell.
    [[nodiscard]] bool is_for_others() const { return is_for_others_; }

  private:
    template <class Worker>
    void visit(const Cell& cell, Worker& worker, std::vector<Cell>* left) {
        if (left != nullptr && cell.level == level_left_) {
            left->push_back(cell);
            return;
        }
        constexpr Int3 kExtent{1, 1, D == 3 ? 1 : 0};
        const Overlap where = overlap_of(box_, cell.low(), cell.low() + kExtent * cell.edge());
        if (where == Overlap::outside) {
            return;
        }
        visited_ += is_for_others_ ? 0 : 1;
        if (!worker.refines(cell, where)) {
            return;
        }
        const Int3 end = lattice_.elements_at(cell.level - 1);
        for (unsigned child = 0; child < 1U << D; ++child) {
            const Cell part{cell.level - 1, cell.at * 2 + corner_offset(child)};
            if (max(part.at + Int3{1, 1, 1}, end) == end) {
                visit(part, worker, left);
            }
        }
    }

    const Lattice& lattice_;
    const ClipBox& box_;
    CubeShare share_;
    bool is_for_others_ = false;
    int level_left_ = 0;
    std::uint64_t visited_ = 0;
};

}  // namespace isonest::detail
