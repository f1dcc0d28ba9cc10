// The indicators of hexahedral and quadrilateral cells by loops over all nodes of each cell, and
// the adaptive grid as a list of its cells.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <vector>

#include "store/lattice/lattice.h"
#include "tests/support/test_support.h"

namespace isonest::detail::test {

/// The indicators of the cells, for each level from 1 on, x fastest.
struct CellNumbers {
    Int3 cells;
    std::vector<double> bar;
    std::vector<double> plus;
};

template <class T>
std::vector<CellNumbers> cell_numbers_by_loops(const FunctionVolume<T>& volume,
                                               const Lattice& lattice) {
    std::vector<CellNumbers> levels;
    for (int level = 1; level <= lattice.top(); ++level) {
        const std::int64_t edge = std::int64_t{1} << level;
        const Int3 n = volume.nodes();
        const Int3 flat{n.x == 1 ? 1 : 0, n.y == 1 ? 1 : 0, n.z == 1 ? 1 : 0};
        CellNumbers e;
        for (int axis = 0; axis < 3; ++axis) {
            e.cells[axis] = std::max<std::int64_t>((n[axis] - 2 + edge) / edge, 1);
        }
        for (std::int64_t i = 0; i < e.cells.product(); ++i) {
            const Int3 cell = e.cells.unlinear(i);
            double eta = 0;
            for (std::int64_t p = 0; p < 27; ++p) {
                const Int3 half = Int3{3, 3, 3}.unlinear(p);
                double linear = 0;
                for (std::int64_t c = 0; c < 8; ++c) {
                    double weight = 1;
                    Int3 corner;
                    for (int axis = 0; axis < 3; ++axis) {
                        const bool high = (c >> axis & 1) != 0;
                        const double t = static_cast<double>(half[axis]) / 2;
                        weight *= flat[axis] != 0 ? 0.5 : high ? t : 1 - t;
                        corner[axis] = flat[axis] != 0 ? 0 : (cell[axis] + (high ? 1 : 0)) * edge;
                    }
                    // A missing corner counts even if its weight is 0.
                    linear += weight * volume.at(corner);
                }
                Int3 node;
                for (int axis = 0; axis < 3; ++axis) {
                    node[axis] = flat[axis] != 0 ? 0 : cell[axis] * edge + half[axis] * edge / 2;
                }
                const double d = std::fabs(volume.at(node) - linear);
                eta = std::isnan(d) ? std::numeric_limits<double>::infinity() : std::max(eta, d);
            }
            double bar = 0;
            double plus = 0;
            for (std::int64_t c = 0; c < 64 && level > 1; ++c) {
                const CellNumbers& finer = levels.back();
                Int3 at = cell * 2 + Int3{4, 4, 4}.unlinear(c) - Int3{1, 1, 1};
                for (int axis = 0; axis < 3; ++axis) {
                    at[axis] = flat[axis] != 0 ? 0 : at[axis];
                }
                if (min(at, {0, 0, 0}) == Int3{0, 0, 0} &&
                    max(at + Int3{1, 1, 1}, finer.cells) == finer.cells) {
                    const auto which = static_cast<std::size_t>(finer.cells.linear(at));
                    bar = std::max(bar, finer.bar[which]);
                    plus = std::max(plus, finer.plus[which]);
                }
            }
            e.bar.push_back(std::max(eta, bar));
            e.plus.push_back(eta + plus);
        }
        levels.push_back(e);
    }
    return levels;
}

/// Refines by the oracle's numbers; finds hanging nodes by checking all leaves.
template <class T>
class CellGridByList {
  public:
    struct Leaf {
        Int3 low;
        Int3 high;  ///< equal to `low` along flat axes

        [[nodiscard]] bool holds(const Int3& p) const {
            return max(p, low) == p && min(p, high) == p;
        }
        [[nodiscard]] bool has_corner(const Int3& p) const {
            return (p.x == low.x || p.x == high.x) && (p.y == low.y || p.y == high.y) &&
                   (p.z == low.z || p.z == high.z);
        }
    };

    struct Measured {
        std::uint64_t visited = 0;
        std::uint64_t leaves = 0;
        std::uint64_t nodes = 0;
        double l1 = 0;
        double l2 = 0;
        double linf = 0;
        double jump = 0;  ///< maximum difference between the values of two cells at a node
        std::size_t hanging = 0;
    };

    CellGridByList(const FunctionVolume<T>& volume, const std::vector<CellNumbers>& numbers,
                   bool plus, double threshold)
        : volume_(volume), numbers_(numbers), plus_(plus), threshold_(threshold) {
        visit(static_cast<int>(numbers.size()), {0, 0, 0});
    }

    Measured measure() {
        std::map<std::array<std::int64_t, 3>, bool> corners;
        for (const Leaf& leaf : leaves_) {
            for (std::int64_t c = 0; c < 8; ++c) {
                const Int3 p = corner(leaf, c);
                corners[{p.x, p.y, p.z}] = true;
            }
        }
        for (const auto& entry : corners) {
            const Int3 p{entry.first[0], entry.first[1], entry.first[2]};
            if (max(p, volume_.nodes() - Int3{1, 1, 1}) != volume_.nodes() - Int3{1, 1, 1}) {
                continue;
            }
            (hangs_on(p) == nullptr ? measured_.nodes : measured_.hanging) += 1;
        }
        const Int3 n = volume_.nodes();
        double weights = 0;
        for (std::int64_t i = 0; i < n.product(); ++i) {
            const Int3 p = n.unlinear(i);
            const double u = volume_.at(p);
            if (std::isnan(u)) {
                continue;
            }
            double weight = 1;
            for (int axis = 0; axis < 3; ++axis) {
                const bool border = p[axis] == 0 || p[axis] == n[axis] - 1;
                weight *= n[axis] > 1 && border ? 0.5 : 1;
            }
            double least = std::numeric_limits<double>::infinity();
            double most = -least;
            for (const Leaf& leaf : leaves_) {
                if (leaf.holds(p)) {
                    least = std::min(least, in_leaf(leaf, p));
                    most = std::max(most, in_leaf(leaf, p));
                }
            }
            measured_.jump = std::max(measured_.jump, most - least);
            const double d = std::fabs(most - u);
            weights += weight;
            measured_.l1 += weight * d;
            measured_.l2 += weight * d * d;
            measured_.linf = std::max(measured_.linf, d);
        }
        measured_.l1 /= weights;
        measured_.l2 = std::sqrt(measured_.l2 / weights);
        measured_.leaves = leaves_.size();
        return measured_;
    }

    /// P U at a node.
    double value(const Int3& p) {
        for (const Leaf& leaf : leaves_) {
            if (leaf.holds(p)) {
                return in_leaf(leaf, p);
            }
        }
        return std::numeric_limits<double>::quiet_NaN();
    }
    /// For each leaf, the number of its edges, 0 ... 4, with a node at the midpoint. REQUIRES: a
    /// plane z = 0.
    [[nodiscard]] std::vector<int> halved_edges() const {
        std::vector<int> counts;
        for (const Leaf& leaf : leaves_) {
            const Int3 sum = leaf.low + leaf.high;
            int halved = 0;
            for (const Int3& twice :
                 {Int3{sum.x, 2 * leaf.low.y, 0}, Int3{sum.x, 2 * leaf.high.y, 0},
                  Int3{2 * leaf.low.x, sum.y, 0}, Int3{2 * leaf.high.x, sum.y, 0}}) {
                const bool is_node = twice.x % 2 == 0 && twice.y % 2 == 0;
                const Int3 p{twice.x / 2, twice.y / 2, 0};
                halved += is_node && std::any_of(leaves_.begin(), leaves_.end(),
                                                 [&](const Leaf& l) { return l.has_corner(p); })
                              ? 1
                              : 0;
            }
            counts.push_back(halved);
        }
        return counts;
    }

  private:
    void visit(int level, const Int3& cell) {
        ++measured_.visited;
        const std::int64_t edge = std::int64_t{1} << level;
        const Int3 n = volume_.nodes();
        const Int3 one{n.x > 1 ? 1 : 0, n.y > 1 ? 1 : 0, n.z > 1 ? 1 : 0};
        if (level > 0) {
            const CellNumbers& of = numbers_[static_cast<std::size_t>(level - 1)];
            const auto which = static_cast<std::size_t>(of.cells.linear(cell));
            if ((plus_ ? of.plus : of.bar)[which] >= threshold_) {
                for (std::int64_t c = 0; c < 8; ++c) {
                    const Int3 o = Int3{2, 2, 2}.unlinear(c);
                    const Int3 child = cell * 2 + o;
                    const Int3 begin = child * (edge / 2);
                    if (max(o, one) == one && (n.x == 1 || begin.x < n.x - 1) &&
                        (n.y == 1 || begin.y < n.y - 1) && (n.z == 1 || begin.z < n.z - 1)) {
                        visit(level - 1, child);
                    }
                }
                return;
            }
        }
        leaves_.push_back({cell * edge, (cell + one) * edge});
    }
    static Int3 corner(const Leaf& leaf, std::int64_t c) {
        const Int3 o = Int3{2, 2, 2}.unlinear(c);
        return {o.x != 0 ? leaf.high.x : leaf.low.x, o.y != 0 ? leaf.high.y : leaf.low.y,
                o.z != 0 ? leaf.high.z : leaf.low.z};
    }
    const Leaf* hangs_on(const Int3& p) const {
        for (const Leaf& leaf : leaves_) {
            if (leaf.holds(p) && !leaf.has_corner(p)) {
                return &leaf;
            }
        }
        return nullptr;
    }
    double at_corner(const Int3& p) {
        const auto [found, is_new] = values_.try_emplace({p.x, p.y, p.z}, 0.0);
        if (is_new) {
            const Leaf* const larger = hangs_on(p);
            const double value = larger != nullptr ? in_leaf(*larger, p) : volume_.at(p);
            found->second = value;
        }
        return values_[{p.x, p.y, p.z}];
    }
    double in_leaf(const Leaf& leaf, const Int3& p) {
        double sum = 0;
        for (std::int64_t c = 0; c < 8; ++c) {
            const Int3 o = Int3{2, 2, 2}.unlinear(c);
            double weight = 1;
            for (int axis = 0; axis < 3; ++axis) {
                const std::int64_t edge = leaf.high[axis] - leaf.low[axis];
                const double t = edge == 0 ? 0
                                           : static_cast<double>(p[axis] - leaf.low[axis]) /
                                                 static_cast<double>(edge);
                weight *= o[axis] != 0 ? t : 1 - t;
            }
            sum += weight > 0 ? weight * at_corner(corner(leaf, c)) : 0;
        }
        return sum;
    }

    const FunctionVolume<T>& volume_;
    const std::vector<CellNumbers>& numbers_;
    bool plus_;
    double threshold_;
    std::vector<Leaf> leaves_;
    std::map<std::array<std::int64_t, 3>, double> values_;
    Measured measured_;
};

}  // namespace isonest::detail::test
