// Implicit grids by explicit bisection, and their assembled matrices.
#pragma once

#include <Eigen/SparseCore>
#include <array>
#include <functional>
#include <map>
#include <set>
#include <vector>

#include "query/traverse/adapt_traverse.h"
#include "store/lattice/lattice.h"
#include "store/lattice/simplex.h"

namespace isonest::detail::test {

/// The coarsest grid without hanging nodes in which no element crosses the volume's border and all
/// nodes of a set are refined. Found by bisecting until nothing changes.
template <int D>
class ExplicitGrid {
  public:
    using Key = std::array<std::int64_t, 3>;
    static Key key(const Int3& p) { return {p.x, p.y, p.z}; }

    /// `wanted`: whether to refine, for a refinement node in the volume and its level.
    ExplicitGrid(const Lattice& lattice, const std::function<bool(const Int3&, int)>& wanted)
        : lattice_(lattice), wanted_(wanted) {
        std::size_t before = 0;
        do {
            before = split_.size();
            leaves_.clear();
            for (const Element<D>& t : coarsest_elements<D>(lattice)) {
                visit(t);
            }
        } while (split_.size() != before);
        for (const Element<D>& t : leaves_) {
            for (const Int3& p : t.v) {
                numbers_.emplace(std::array{p.z, p.y, p.x}, 0);
            }
        }
        std::size_t next = 0;
        for (auto& [p, number] : numbers_) {
            number = next++;
        }
    }
    [[nodiscard]] const std::vector<Element<D>>& leaves() const { return leaves_; }
    [[nodiscard]] std::size_t count() const { return numbers_.size(); }
    [[nodiscard]] std::size_t number(const Int3& p) const { return numbers_.at({p.z, p.y, p.x}); }
    [[nodiscard]] bool contains(const Int3& p) const { return numbers_.count({p.z, p.y, p.x}) > 0; }

    /// Adds local(simplex, leaf)(i, j) for all leaves.
    template <class Local>
    [[nodiscard]] Eigen::SparseMatrix<double> assemble(const Double3& spacing,
                                                       const Local& local) const {
        std::vector<Eigen::Triplet<double>> entries;
        for (const Element<D>& t : leaves_) {
            Simplex s;
            s.flat = lattice_.flat_axes();
            s.vertices = D + 1;
            for (std::size_t i = 0; i <= D; ++i) {
                for (int a = 0; a < 3; ++a) {
                    s.v[i][static_cast<std::size_t>(a)] =
                        static_cast<double>(t.v[i][a]) * spacing[static_cast<std::size_t>(a)];
                }
            }
            const auto entry = local(s, t);
            for (std::size_t i = 0; i <= D; ++i) {
                for (std::size_t j = 0; j <= D; ++j) {
                    entries.emplace_back(static_cast<int>(number(t.v[i])),
                                         static_cast<int>(number(t.v[j])), entry(i, j));
                }
            }
        }
        Eigen::SparseMatrix<double> m(static_cast<int>(count()), static_cast<int>(count()));
        m.setFromTriplets(entries.begin(), entries.end());
        return m;
    }

  private:
    [[nodiscard]] int side(const Element<D>& t) const {  // 0 inside, 1 across the border, 2 outside
        const auto [low, high] = t.bounds();
        int found = 0;
        for (int a = 0; a < 3; ++a) {
            const std::int64_t last = lattice_.nodes()[a] - 1;
            if (high[a] > last) {
                if (low[a] >= last) {
                    return 2;
                }
                found = 1;
            }
        }
        return found;
    }
    /// Whether it or one of its descendants is refined.
    bool has_refined(const Element<D>& t) {
        if (t.level == 0 || side(t) == 2) {
            return false;
        }
        const Int3 x = t.ref_node();
        const bool inside = min(x, lattice_.nodes() - Int3{1, 1, 1}) == x;
        if (side(t) == 1 || split_.count(key(x)) != 0 || (inside && wanted_(x, t.level))) {
            return true;
        }
        const auto halves = t.bisect(0);
        return has_refined(halves[0]) || has_refined(halves[1]);
    }
    void visit(const Element<D>& t) {
        if (side(t) == 2) {
            return;
        }
        if (has_refined(t)) {
            split_.insert(key(t.ref_node()));
            for (const Element<D>& half : t.bisect(0)) {
                visit(half);
            }
        } else {
            leaves_.push_back(t);
        }
    }

    Lattice lattice_;
    std::function<bool(const Int3&, int)> wanted_;
    std::set<Key> split_;
    std::vector<Element<D>> leaves_;
    std::map<Key, std::size_t> numbers_;  ///< by z, y, x
};

}  // namespace isonest::detail::test
