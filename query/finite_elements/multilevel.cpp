// The preconditioner of Bramble, Pasciak and Xu on the nested grid.
//
// Source: J. Bramble, J. Pasciak, J. Xu, "Parallel multilevel preconditioners", Math. Comp. 55
// (1990); for locally refined grids W. Dahmen, A. Kunoth, "Multilevel preconditioning", Numer.
// Math. 63 (1992); for domains that end within elements of the coarse grids R. Kornhuber, H.
// Yserentant, "Multilevel methods for elliptic problems on domains not resolved by the coarse
// grid", Contemp. Math. 180 (1994).
//
// The grid of level l consists of the active nodes on the lattice of every 2^l-th node. A node of
// that lattice with an odd coordinate is the midpoint of its refinement edge, whose ends are nodes
// of the next coarser lattice: along the axes on which the node is odd, one end is even (a multiple
// of twice the step) and the other is odd. So functions move between two lattices row by row.
#include <fmt/format.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <cmath>

#include <isonest/error.h>
#include <isonest/operator.h>

#include "query/finite_elements/active_nodes.h"
#include "query/finite_elements/grid_operator.h"
#include "query/finite_elements/grid_parts.h"

namespace isonest {
namespace detail {
namespace {

constexpr std::int64_t kRowsPerTask = 16;

/// A level's nodes: the active nodes of a lattice, which may extend beyond the volume.
struct LevelNodes {
    const NodeSet* set = nullptr;
    bool is_full = false;

    explicit LevelNodes(const NodeSet& nodes) : set(&nodes), is_full(nodes.is_full()) {}
    [[nodiscard]] const Int3& size() const { return set->nodes(); }

    /// Row (y, z) of a function, with 0 at nodes that are not active.
    template <class Real>
    void read(std::span<const Real> all, std::int64_t y, std::int64_t z, Real* to) const {
        if (is_full) {
            const auto first = static_cast<std::size_t>(size().linear({0, y, z}));
            std::copy_n(all.data() + first, size().x, to);
            return;
        }
        std::fill_n(to, size().x, Real{0});
        set->for_row({0, y, z}, size().x,
                     [&](std::int64_t x, std::uint64_t number) { to[x] = all[number]; });
    }
    /// Calls f(x, number) for the active nodes of a row.
    template <class F>
    void for_row(std::int64_t y, std::int64_t z, const F& f) const {
        if (is_full) {
            const auto first = static_cast<std::uint64_t>(size().linear({0, y, z}));
            for (std::int64_t x = 0; x < size().x; ++x) {
                f(x, first + static_cast<std::uint64_t>(x));
            }
            return;
        }
        set->for_row({0, y, z}, size().x, f);
    }
};

/// Buffers of a thread.
template <class Real>
struct RowBuffers {
    std::vector<Real> fine;
    std::vector<Real> even;
    std::vector<Real> odd;

    explicit RowBuffers(const Int3& coarse)
        : fine(static_cast<std::size_t>(2 * coarse.x + 1)),
          even(static_cast<std::size_t>(coarse.x + 1)),
          odd(static_cast<std::size_t>(coarse.x + 1)) {}
};

template <class Real, class F>
void for_rows(const Int3& coarse, const Int3& size, const F& f) {
    tbb::enumerable_thread_specific<RowBuffers<Real>> buffers(
        [&] { return RowBuffers<Real>(coarse); });
    tbb::parallel_for(tbb::blocked_range<std::int64_t>(0, size.y * size.z, kRowsPerTask),
                      [&](const auto& r) {
                          RowBuffers<Real>& mine = buffers.local();
                          for (std::int64_t row = r.begin(); row < r.end(); ++row) {
                              f(row % size.y, row / size.y, mine);
                          }
                      });
}

/// out(coarse node) = sum over the fine nodes of the coarse node's function times r.
template <class Real>
void restrict_level(const LevelNodes& fine, const LevelNodes& coarse, std::span<const Real> r,
                    std::span<Real> out) {
    const Int3 n = fine.size();
    const bool has_x = n.x > 1;
    for_rows<Real>(coarse.size(), coarse.size(), [&](std::int64_t y, std::int64_t z, auto& rows) {
        const std::int64_t count = coarse.size().x;
        Real* const sum = rows.even.data();
        // Fine node x is at [x + 1]; those beyond the lattice are 0.
        Real* const row = rows.fine.data() + 1;
        std::fill_n(sum, count, Real{0});
        for (std::int64_t dz = -1; dz <= 1; ++dz) {
            for (std::int64_t dy = -1; dy <= 1; ++dy) {
                const std::int64_t at_y = 2 * y + dy;
                const std::int64_t at_z = 2 * z + dz;
                const bool mixed = dy != 0 && dz != 0 && ((y ^ z) & 1) != 0;
                if (mixed || at_y < 0 || at_z < 0 || at_y >= n.y || at_z >= n.z) {
                    continue;
                }
                std::fill(rows.fine.begin(), rows.fine.end(), Real{0});
                fine.read(r, at_y, at_z, row);
                if (!has_x) {
                    sum[0] += dy == 0 && dz == 0 ? row[0] : Real{0.5} * row[0];
                    continue;
                }
                if (dy == 0 && dz == 0) {
                    for (std::int64_t x = 0; x < count; ++x) {
                        sum[x] += row[2 * x] + Real{0.5} * (row[2 * x - 1] + row[2 * x + 1]);
                    }
                    continue;
                }
                for (std::int64_t x = 0; x < count; ++x) {
                    sum[x] += Real{0.5} * row[2 * x];
                }
                for (std::int64_t x = (dy != 0 ? y : z) & 1; x < count; x += 2) {
                    sum[x] += Real{0.5} * (row[2 * x - 1] + row[2 * x + 1]);
                }
            }
        }
        coarse.for_row(y, z, [&](std::int64_t x, std::uint64_t number) { out[number] = sum[x]; });
    });
}

/// out = weight * r + the coarse function at the fine nodes.
template <class Real>
void prolong_level(const LevelNodes& fine, const LevelNodes& coarse, std::span<const Real> c,
                   std::span<const Real> weight, std::span<const Real> r, std::span<Real> out) {
    const bool has_x = fine.size().x > 1;
    for_rows<Real>(coarse.size(), fine.size(), [&](std::int64_t y, std::int64_t z, auto& rows) {
        // The rows of the even and of the odd end.
        const std::int64_t low_y = y / 2;
        const std::int64_t low_z = z / 2;
        const std::int64_t odd_y = y & 1;
        const std::int64_t odd_z = z & 1;
        const std::int64_t even_end_y = low_y + (odd_y & low_y);
        const std::int64_t even_end_z = low_z + (odd_z & low_z);
        const std::int64_t odd_end_y = low_y + (odd_y & ~low_y);
        const std::int64_t odd_end_z = low_z + (odd_z & ~low_z);
        Real* const even = rows.even.data();
        Real* const odd = rows.odd.data();
        coarse.read(c, even_end_y, even_end_z, even);
        coarse.read(c, odd_end_y, odd_end_z, odd);
        if (!has_x) {
            fine.for_row(y, z, [&](std::int64_t, std::uint64_t number) {
                out[number] = weight[number] * r[number] + Real{0.5} * (even[0] + odd[0]);
            });
            return;
        }
        Real* const row = rows.fine.data();
        for (std::int64_t x = 0; 2 * x < fine.size().x; ++x) {
            row[2 * x] = Real{0.5} * (even[x] + odd[x]);
        }
        for (std::int64_t x = 0; 2 * x + 1 < fine.size().x; ++x) {
            row[2 * x + 1] =
                Real{0.5} * ((x & 1) == 0 ? even[x] + odd[x + 1] : odd[x] + even[x + 1]);
        }
        fine.for_row(y, z, [&](std::int64_t x, std::uint64_t number) {
            out[number] = weight[number] * r[number] + row[x];
        });
    });
}

/// A level's share of one unknown of each node.
template <class Real>
struct LevelVectors {
    std::vector<Real> weight;    ///< 1 / a(phi, phi), or 0 for functions that are not in the sum
    std::vector<Real> residual;  ///< empty at the finest level
    std::vector<Real> sum;
};

/// 1 / a(phi, phi) of the functions of a level.
template <class Real>
std::vector<Real> inverse_diagonal(const Lattice& lattice, const Double3& spacing,
                                   const NodeSet& set, const MultilevelOptions& options,
                                   int threads) {
    GridOperator<Real> op(lattice, spacing, set, threads);
    std::vector<Real> diagonal(static_cast<std::size_t>(set.count()));
    std::vector<Real> mass;
    if (options.stiffness > 0) {
        op.stiffness_diagonal({}, options.stiffness, diagonal);
    }
    if (options.mass > 0) {
        mass.resize(diagonal.size());
        op.lumped_mass(mass);
    }
    const auto factor = static_cast<Real>(options.mass * 2 / (lattice.dimension() + 2));
    for (std::size_t i = 0; i < diagonal.size(); ++i) {
        const Real d = diagonal[i] + (mass.empty() ? Real{0} : factor * mass[i]);
        diagonal[i] = d > 0 ? 1 / d : Real{0};
    }
    return diagonal;
}

/// The grid whose elements are refined one level less: the nodes of every second one of the
/// lattice, and the ends of refinement edges that are beyond the volume.
NodeSet coarser(const NodeSet& fine, const Lattice& lattice, int threads) {
    NodeSet marked(lattice.nodes());
    fine.for_each([&](const Int3& p, std::size_t) {
        Int3 even{};
        Int3 odd{};
        for (int axis = 0; axis < 3; ++axis) {
            const std::int64_t low = p[axis] / 2;
            even[axis] = low + (p[axis] & low & 1);
            odd[axis] = low + (p[axis] & ~low & 1);
        }
        marked.insert(even);
        marked.insert(odd);
    });
    return active_nodes(
        lattice, [&](const Int3& p, int) { return marked.contains(p); }, threads,
        silent_progress());
}

}  // namespace

template <int D, class Real>
struct MultilevelParts {
    ImplicitGrid<D> grid;
    std::vector<NodeSet> coarse;     ///< of levels 1, 2, ..
    std::vector<LevelNodes> levels;  ///< all, the finest first
    std::size_t unknowns;
    /// [unknown][level]; a single unknown stands for all that have the same fixed nodes.
    std::vector<std::vector<LevelVectors<Real>>> vectors;
    std::vector<Real> one_in;  ///< one unknown of each node, if there are several
    std::vector<Real> one_out;

    MultilevelParts(const ImplicitGrid<D>& on, const MultilevelOptions& options,
                    std::span<const Real> diagonal)
        : grid(on), unknowns(static_cast<std::size_t>(options.unknowns)) {
        const GridParts<D>& parts = grid.parts();
        std::vector<Lattice> lattices{parts.lattice};
        while (lattices.back().top() > 0) {
            lattices.emplace_back(lattices.back().nodes_at(1));
        }
        coarse.reserve(lattices.size() - 1);
        levels.emplace_back(parts.nodes);
        for (std::size_t l = 1; l < lattices.size(); ++l) {
            coarse.push_back(coarser(*levels.back().set, lattices[l], parts.threads));
            levels.emplace_back(coarse.back());
        }
        const std::vector<std::vector<std::uint8_t>> used = used_functions();
        std::vector<std::vector<Real>> inverse;
        for (std::size_t l = 0; l < levels.size(); ++l) {
            Double3 spacing = parts.spacing;
            for (double& s : spacing) {
                s = std::ldexp(s, static_cast<int>(l));
            }
            inverse.push_back(inverse_diagonal<Real>(lattices[l], spacing, *levels[l].set, options,
                                                     parts.threads));
        }
        const std::size_t nodes = grid.count();
        for (std::size_t k = 0; k < unknowns; ++k) {
            std::vector<std::uint8_t> fixed(nodes);
            for (std::size_t i = 0; i < nodes && !options.fixed.empty(); ++i) {
                fixed[i] = options.fixed[i * unknowns + k];
            }
            std::vector<Real> ratio;
            for (std::size_t i = 0; i < nodes && !diagonal.empty(); ++i) {
                ratio.push_back(diagonal[i * unknowns + k] * inverse[0][i]);
            }
            vectors.push_back(weights(inverse, used, fixed, ratio));
        }
        if (unknowns > 1) {
            one_in.resize(nodes);
            one_out.resize(nodes);
        }
    }

    /// 1 for functions that differ from those of the next coarser level: of nodes that are new, and
    /// of the ends of their refinement edges.
    [[nodiscard]] std::vector<std::vector<std::uint8_t>> used_functions() const {
        std::vector<std::vector<std::uint8_t>> used;
        for (std::size_t l = 0; l < levels.size(); ++l) {
            const bool is_last = l + 1 == levels.size();
            std::vector<float> is_new(static_cast<std::size_t>(levels[l].set->count()));
            std::vector<float> is_end;
            levels[l].set->for_each([&](const Int3& p, std::size_t i) {
                is_new[i] = is_last || ((p.x | p.y | p.z) & 1) != 0 ? 1 : 0;
            });
            used.emplace_back(is_new.size());
            if (!is_last) {
                is_end.resize(static_cast<std::size_t>(levels[l + 1].set->count()));
                grid.parts().workers.execute(
                    [&] { restrict_level<float>(levels[l], levels[l + 1], is_new, is_end); });
            }
            levels[l].set->for_each([&](const Int3& p, std::size_t i) {
                const Int3 half{p.x / 2, p.y / 2, p.z / 2};
                used[l][i] = is_new[i] > 0 || is_end[levels[l + 1].set->number(half)] > 0 ? 1 : 0;
            });
        }
        return used;
    }
    /// The vectors of an unknown, without the functions that are not 0 at a fixed node. `ratio`: of
    /// the diagonals of its matrix and of the one given by the options, at each node; may be empty.
    [[nodiscard]] std::vector<LevelVectors<Real>> weights(
        const std::vector<std::vector<Real>>& inverse,
        const std::vector<std::vector<std::uint8_t>>& used, const std::vector<std::uint8_t>& fixed,
        std::vector<Real> ratio) const {
        const auto restricted = [&]<class Number>(std::size_t l, const std::vector<Number>& from) {
            std::vector<Number> to(inverse[l].size());
            grid.parts().workers.execute(
                [&] { restrict_level<Number>(levels[l - 1], levels[l], from, to); });
            return to;
        };
        std::vector<LevelVectors<Real>> made(levels.size());
        std::vector<float> reaches(fixed.begin(), fixed.end());
        std::vector<Real> ones(ratio.size(), Real{1});
        for (std::size_t l = 0; l < levels.size(); ++l) {
            if (l > 0) {
                reaches = restricted(l, reaches);
                made[l].residual.resize(inverse[l].size());
                made[l].sum.resize(inverse[l].size());
                if (!ratio.empty()) {
                    // Their quotient is the mean of the ratio, weighted with the level's function.
                    ratio = restricted(l, ratio);
                    ones = restricted(l, ones);
                }
            }
            made[l].weight = inverse[l];
            for (std::size_t i = 0; i < reaches.size(); ++i) {
                Real& weight = made[l].weight[i];
                if (reaches[i] > 0 || used[l][i] == 0) {
                    weight = 0;
                } else if (!ratio.empty() && ratio[i] > 0) {
                    weight *= ones[i] / ratio[i];
                }
                reaches[i] = reaches[i] > 0 ? 1 : 0;  // sums of many levels may become too small
            }
        }
        return made;
    }

    void apply(std::vector<LevelVectors<Real>>& v, std::span<const Real> r, std::span<Real> z) {
        const auto residual = [&](std::size_t l) {
            return l == 0 ? r : std::span<const Real>(v[l].residual);
        };
        grid.parts().workers.execute([&] {
            for (std::size_t l = 1; l < levels.size(); ++l) {
                restrict_level<Real>(levels[l - 1], levels[l], residual(l - 1), v[l].residual);
            }
            const std::size_t last = levels.size() - 1;
            const std::span<Real> top = last == 0 ? z : std::span<Real>(v[last].sum);
            for (std::size_t i = 0; i < top.size(); ++i) {
                top[i] = v[last].weight[i] * residual(last)[i];
            }
            for (std::size_t l = last; l-- > 0;) {
                prolong_level<Real>(levels[l], levels[l + 1], v[l + 1].sum, v[l].weight,
                                    residual(l), l == 0 ? z : std::span<Real>(v[l].sum));
            }
        });
    }
};

}  // namespace detail

template <int D, class Real>
Multilevel<D, Real>::Multilevel(const ImplicitGrid<D>& grid, const MultilevelOptions& options,
                                std::span<const Real> diagonal) {
    const auto is_factor = [](double f) { return f >= 0 && std::isfinite(f); };
    if (!is_factor(options.stiffness) || !is_factor(options.mass) ||
        options.stiffness + options.mass <= 0) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("a preconditioner for {} times the stiffness matrix and {} times the mass "
                        "matrix: neither factor may be negative, and one must be positive",
                        options.stiffness, options.mass));
    }
    if (options.unknowns < 1) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} unknowns for each node: give at least 1", options.unknowns));
    }
    const std::size_t size = grid.count() * static_cast<std::size_t>(options.unknowns);
    if (!options.fixed.empty() && options.fixed.size() != size) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("{} unknowns, but {} flags of fixed ones", size, options.fixed.size()));
    }
    if (!diagonal.empty() && diagonal.size() != size) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("{} unknowns, but {} numbers on the diagonal", size, diagonal.size()));
    }
    parts_ = std::make_shared<detail::MultilevelParts<D, Real>>(grid, options, diagonal);
}

template <int D, class Real>
void Multilevel<D, Real>::operator()(std::span<const Real> r, std::span<Real> z) const {
    auto& parts = *parts_;
    const std::size_t unknowns = parts.unknowns;
    if (unknowns == 1) {
        return parts.apply(parts.vectors[0], r, z);
    }
    for (std::size_t k = 0; k < unknowns; ++k) {
        for (std::size_t i = 0; i < parts.one_in.size(); ++i) {
            parts.one_in[i] = r[i * unknowns + k];
        }
        parts.apply(parts.vectors[k], parts.one_in, parts.one_out);
        for (std::size_t i = 0; i < parts.one_out.size(); ++i) {
            z[i * unknowns + k] = parts.one_out[i];
        }
    }
}

template <int D, class Real>
std::uint64_t Multilevel<D, Real>::heap() const {
    std::uint64_t numbers = parts_->one_in.size() + parts_->one_out.size();
    for (const auto& of_unknown : parts_->vectors) {
        for (const detail::LevelVectors<Real>& v : of_unknown) {
            numbers += v.weight.size() + v.residual.size() + v.sum.size();
        }
    }
    std::uint64_t bytes = numbers * sizeof(Real);
    for (const NodeSet& set : parts_->coarse) {
        bytes += set.heap();
    }
    return bytes;
}

template class Multilevel<1, float>;
template class Multilevel<2, float>;
template class Multilevel<3, float>;
template class Multilevel<1, double>;
template class Multilevel<2, double>;
template class Multilevel<3, double>;

}  // namespace isonest
