// The functions of GridOperator, for instantiation with float and double.
#pragma once

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cassert>
#include <cmath>

#include "query/finite_elements/block_product.h"
#include "query/finite_elements/grid_elements.h"
#include "query/finite_elements/grid_operator.h"

namespace isonest::detail {

inline constexpr std::size_t kNodesPerTask = 1U << 16U;

/// Constants of the elements of each kind and level. `Real`: of the function.
template <class Real, int D>
TermsTable<Real, D> terms_of(const Lattice& lattice, const Double3& spacing, double scale,
                             double lambda) {
    TermsTable<Real, D> table;
    double volume = D == 3 ? 1.0 / 6 : D == 2 ? 0.5 : 1;
    for (unsigned axis = 0; axis < 3; ++axis) {
        volume *= (lattice.flat_axes() >> axis & 1U) != 0 ? 1 : spacing[axis];
    }
    for (int level = 0; level <= lattice.top(); ++level) {
        for (int kind = 0; kind < D; ++kind) {
            ElementTerms<Real>& t =
                table.at(static_cast<std::size_t>(level)).at(static_cast<std::size_t>(kind));
            const double v = std::ldexp(volume, D * level - kind);
            t.volume = static_cast<Real>(v);
            t.stiffness = static_cast<Real>(v * scale);
            t.inverse_lambda = static_cast<Real>(1 / (lambda * lambda));
            for (std::size_t axis = 0; axis < 3; ++axis) {
                t.inverse.at(axis) =
                    static_cast<Real>(std::ldexp(1 / (spacing[axis] * spacing[axis]), -2 * level));
            }
        }
    }
    return table;
}

template <class Real>
void fill_with_zeros(std::span<Real> all) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, all.size(), kNodesPerTask),
                      [&](const tbb::blocked_range<std::size_t>& r) {
                          std::fill(all.begin() + static_cast<std::ptrdiff_t>(r.begin()),
                                    all.begin() + static_cast<std::ptrdiff_t>(r.end()), Real{0});
                      });
}

template <class Real>
struct GridOperator<Real>::Input {
    std::span<const Real> value;
    std::span<const Real> stopping;
    double lambda = 1;
    double scale = 1;
    std::span<Real> out;
};

template <class Real>
template <class F>
auto GridOperator<Real>::with_dimension(const F& f) {
    switch (lattice_.dimension()) {
        case 1:
            return f.template operator()<1>();
        case 2:
            return f.template operator()<2>();
        default:
            return f.template operator()<3>();
    }
}

template <class Real>
GridOperator<Real>::GridOperator(const Lattice& lattice, const Double3& spacing,
                                 const NodeSet& nodes, int threads)
    : lattice_(lattice), spacing_(spacing), nodes_(nodes), workers_(threads) {
    blocks_ = with_dimension([&]<int D>() { return find_blocks<D>(lattice_, nodes_); });
}

template <class Real>
template <ElementWork Work, bool HasCoefficient, int D>
void GridOperator<Real>::add_coarse(const Input& input) {
    const auto terms = terms_of<Real, D>(lattice_, spacing_, input.scale, input.lambda);
    for_coarse_leaves<D>(lattice_, nodes_, blocks_.level, [&]<int Kind>(const Element<D>& leaf) {
        std::array<Real, static_cast<std::size_t>(D) + 1> value{};
        std::array<Real, static_cast<std::size_t>(D) + 1> stopping{};
        std::array<Real, static_cast<std::size_t>(D) + 1> out{};
        std::array<std::uint64_t, static_cast<std::size_t>(D) + 1> node{};
        for (std::size_t i = 0; i <= D; ++i) {
            node[i] = nodes_.number(leaf.v[i]);
            value[i] = input.value.empty() ? Real{} : input.value[node[i]];
            stopping[i] = input.stopping.empty() ? Real{} : input.stopping[node[i]];
        }
        add_element<Work, HasCoefficient, D, Kind>(
            terms[static_cast<std::size_t>(leaf.level)][static_cast<std::size_t>(Kind)],
            axes_of(leaf), value, stopping, out);
        for (std::size_t i = 0; i <= D; ++i) {
            input.out[node[i]] += out[i];
        }
    });
}

template <class Real>
template <int D>
BlockCommon<Real, D> GridOperator<Real>::common(const Input& input) const {
    auto common = block_common<Real, D>(lattice_, nodes_, blocks_.level);
    common.value = input.value;
    common.stopping = input.stopping;
    common.terms = terms_of<Real, D>(lattice_, spacing_, input.scale, input.lambda);
    return common;
}

template <class Real>
template <ElementWork Work, bool HasCoefficient, int D>
void GridOperator<Real>::run(const Input& input) {
    using Product = BlockProduct<Work, HasCoefficient, Real, D>;
    const BlockCommon<Real, D> common = this->common<D>(input);
    workers_.execute([&] {
        fill_with_zeros(input.out);
        add_coarse<Work, HasCoefficient, D>(input);
        tbb::enumerable_thread_specific<Product> products(
            [&] { return Product(common, input.out); });
        for (const std::vector<GridBlock>& same : blocks_.groups) {
            tbb::parallel_for(tbb::blocked_range<std::size_t>(0, same.size()),
                              [&](const tbb::blocked_range<std::size_t>& r) {
                                  Product& product = products.local();
                                  for (std::size_t i = r.begin(); i < r.end(); ++i) {
                                      const auto& c = same[i].corner;
                                      product({c[0], c[1], c[2]}, same[i].elements);
                                  }
                              });
        }
    });
}

template <class Real>
template <bool HasCoefficient, int D>
std::optional<GridMatrix<Real>> GridOperator<Real>::assemble(const Input& input,
                                                             std::span<Real> mass,
                                                             std::uint64_t most) {
    using Weights = BlockWeights<HasCoefficient, Real, D>;
    const BlockCommon<Real, D> common = this->common<D>(input);
    const std::span<Real> diagonal = input.out;
    GridMatrix<Real> matrix;
    std::atomic<std::uint64_t> bytes = 0;
    workers_.execute([&] {
        struct Local {
            Weights weights;
            EdgeWeights<Real> found;
        };
        fill_with_zeros(mass);
        fill_with_zeros(diagonal);
        add_coarse_weights<HasCoefficient, D>(input, mass, matrix);
        bytes = matrix.heap();
        tbb::enumerable_thread_specific<Local> locals([&] { return Local{Weights(common), {}}; });
        for (std::size_t group = 0; group < blocks_.groups.size(); ++group) {
            const std::vector<GridBlock>& same = blocks_.groups[group];
            auto& made = matrix.blocks_[group];
            bytes += same.size() * sizeof(EdgeWeights<Real>);
            if (bytes > most) {
                return;
            }
            made.resize(same.size());
            tbb::parallel_for(
                tbb::blocked_range<std::size_t>(0, same.size()),
                [&](const tbb::blocked_range<std::size_t>& r) {
                    auto& [weights, found] = locals.local();
                    for (std::size_t i = r.begin(); i < r.end() && bytes <= most; ++i) {
                        const auto& c = same[i].corner;
                        found.clear();
                        weights({c[0], c[1], c[2]}, same[i].elements, mass, diagonal, found);
                        bytes += found.heap();
                        if (bytes <= most) {
                            made[i] = found;
                        }
                    }
                });
        }
    });
    if (bytes > most) {
        return std::nullopt;
    }
    return matrix;
}

template <class Real>
template <bool HasCoefficient, int D>
void GridOperator<Real>::add_coarse_weights(const Input& input, std::span<Real> mass,
                                            GridMatrix<Real>& matrix) {
    const auto terms = terms_of<Real, D>(lattice_, spacing_, input.scale, input.lambda);
    for_coarse_leaves<D>(lattice_, nodes_, blocks_.level, [&]<int Kind>(const Element<D>& leaf) {
        const ElementTerms<Real>& t =
            terms[static_cast<std::size_t>(leaf.level)][static_cast<std::size_t>(Kind)];
        const ElementAxes<D> axes = axes_of(leaf);
        std::array<Real, static_cast<std::size_t>(D)> inverse{};
        std::array<Real, static_cast<std::size_t>(D) + 1> stopping{};
        std::array<std::uint64_t, static_cast<std::size_t>(D) + 1> node{};
        for (std::size_t j = 0; j < D; ++j) {
            inverse[j] = t.inverse[static_cast<std::size_t>(axes[j])];
        }
        for (std::size_t i = 0; i <= D; ++i) {
            node[i] = nodes_.number(leaf.v[i]);
            stopping[i] = HasCoefficient ? input.stopping[node[i]] : Real{};
            mass[node[i]] += t.volume / (D + 1);
        }
        Real scale = t.stiffness;
        if constexpr (HasCoefficient) {
            scale /= 1 + gradient_squared<D, Kind>(stopping, inverse) * t.inverse_lambda;
        }
        for_couplings<D, Kind>(scale, inverse, [&]<std::size_t I, std::size_t J>(Real weight) {
            input.out[node[I]] += weight;
            input.out[node[J]] += weight;
            matrix.coarse_.push_back({node[I], node[J], weight});
        });
    });
}

template <class Real>
template <ElementWork Work>
void GridOperator<Real>::dispatch_run(const Input& input) {
    assert(input.out.size() == nodes_.count());
    with_dimension([&]<int D>() {
        if constexpr (Work == ElementWork::stiffness || Work == ElementWork::stiffness_diagonal) {
            if (!input.stopping.empty()) {
                return run<Work, true, D>(input);
            }
        }
        run<Work, false, D>(input);
    });
}

template <class Real>
std::optional<GridMatrix<Real>> GridOperator<Real>::assemble(const Coefficient<Real>& a,
                                                             double scale, std::span<Real> mass,
                                                             std::span<Real> diagonal,
                                                             std::uint64_t most) {
    const Input input{{}, a.of, a.lambda, scale, diagonal};
    return with_dimension([&]<int D>() {
        return a.of.empty() ? assemble<false, D>(input, mass, most)
                            : assemble<true, D>(input, mass, most);
    });
}

template <class Real>
void GridOperator<Real>::stiffness(const Coefficient<Real>& a, double scale,
                                   std::span<const Real> w, std::span<Real> out) {
    dispatch_run<ElementWork::stiffness>({w, a.of, a.lambda, scale, out});
}

template <class Real>
void GridOperator<Real>::stiffness_diagonal(const Coefficient<Real>& a, double scale,
                                            std::span<Real> out) {
    dispatch_run<ElementWork::stiffness_diagonal>({{}, a.of, a.lambda, scale, out});
}

template <class Real>
void GridOperator<Real>::mass(std::span<const Real> w, std::span<Real> out) {
    dispatch_run<ElementWork::consistent_mass>({w, {}, 1, 1, out});
}

template <class Real>
void GridOperator<Real>::lumped_mass(std::span<Real> out) {
    dispatch_run<ElementWork::lumped_mass>({{}, {}, 1, 1, out});
}

}  // namespace isonest::detail
