// One block's part of z = A w: gathers its nodes, visits its leaves, and scatters the sums.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "query/finite_elements/block_elements.h"
#include "query/finite_elements/grid_operator.h"

namespace isonest::detail {

template <ElementWork Work, bool Coefficient, class Real, int D>
class BlockProduct {
  public:
    BlockProduct(const BlockCommon<Real, D>& common, std::span<Real> out)
        : common_(common), out_(out), nodes_(common), sum_(nodes_.block.layout.size()) {}

    /// `elements`: bits of this block's walks.
    void operator()(const Int3& corner, std::uint32_t elements) {
        nodes_.gather(corner);
        std::fill(sum_.begin(), sum_.end(), Real{0});
        if constexpr (D == 3) {
            const ElementTerms<Real>& t = common_.terms[0][0];
            const FinestTerms<Real> terms{t.volume, t.stiffness, t.inverse, t.inverse_lambda};
            nodes_.for_finest_cells(
                [&](std::int64_t /*y*/, std::int64_t /*z*/, const auto& first, std::uint32_t parity,
                    const Real* there) { add_cells(terms, first, parity, there); });
        }
        AddsLeaf add{common_, nodes_.block, sum_};
        nodes_.visit(elements, add);
        scatter();
    }

  private:
    struct AddsLeaf {
        const BlockCommon<Real, D>& common;
        const LocalBlock<Real, D>& block;
        std::vector<Real>& sum;

        template <int Kind>
        void operator()(const BlockVertices<D>& v, const ElementAxes<D>& axes, int level) {
            std::array<Real, static_cast<std::size_t>(D) + 1> value;
            std::array<Real, static_cast<std::size_t>(D) + 1> stopping;
            std::array<Real, static_cast<std::size_t>(D) + 1> out{};
            for (std::size_t i = 0; i <= D; ++i) {
                value[i] = block.value[v[i].at];
                stopping[i] = block.stopping[v[i].at];
            }
            add_element<Work, Coefficient, D, Kind>(
                common.terms[static_cast<std::size_t>(level)][static_cast<std::size_t>(Kind)], axes,
                value, stopping, out);
            for (std::size_t i = 0; i <= D; ++i) {
                sum[v[i].at] += out[i];
            }
        }
    };

    void add_cells(const FinestTerms<Real>& terms, const std::array<std::uint32_t, 4>& first,
                   std::uint32_t parity, const Real* there) {
        const LocalBlock<Real, D>& block = nodes_.block;
        const auto rows = [&](const std::vector<Real>& a) {
            return corner_rows<NodeRow<Real>, D>(a.data(), first, parity);
        };
        const auto sums = corner_rows<SumRow<Real>, D>(sum_.data(), first, parity);
        if constexpr (std::is_same_v<Real, float> && Work == ElementWork::stiffness) {
            if constexpr (Coefficient) {
                add_finest_products(terms, rows(block.value), rows(block.stopping),
                                    rows(block.active), there, sums);
            } else {
                add_finest_products(terms, rows(block.value), rows(block.active), there, sums);
            }
        } else {
            add_finest<Work, Coefficient>(terms, rows(block.value), rows(block.stopping),
                                          rows(block.active), there, sums);
        }
    }

    void scatter() {
        nodes_.for_rows([&](std::uint32_t first, const Int3& p, std::int64_t count) {
            const Real* const sum = sum_.data() + first;
            if (count <= 64 && common_.nodes->contains_row(p, count)) {
                Real* const to = out_.data() + common_.nodes->number_from(p);
                const Real* const odd = sum + BlockLayout<D>::kEven;
                for (std::int64_t i = 0; i < count / 2; ++i) {
                    to[2 * i] += sum[i];
                    to[2 * i + 1] += odd[i];
                }
                if (count % 2 != 0) {
                    to[count - 1] += sum[count / 2];
                }
                return;
            }
            common_.nodes->for_row(p, count, [&](std::int64_t x, std::uint64_t n) {
                out_[n] += sum[BlockLayout<D>::in_row(static_cast<std::uint32_t>(x - p.x))];
            });
        });
    }

    const BlockCommon<Real, D>& common_;
    std::span<Real> out_;
    BlockNodes<Work == ElementWork::stiffness || Work == ElementWork::consistent_mass, Coefficient,
               Real, D>
        nodes_;
    std::vector<Real> sum_;
};

// One block's part of an assembled stiffness matrix: a weight for each edge of its leaves.
//
// The rows of the stiffness matrix of linear functions have sum 0, so B w = sum over the edges of
// weight (w_i - w_j) at i, and the opposite at j; the weight is -B_ij. An edge runs along one of 13
// directions (axes, diagonals of squares, diagonals of cubes), and at most one in each direction
// starts at a node; so the weights are summed in 13 arrays over the block's nodes. In a mesh
// without hanging nodes no vertex lies between the ends of an edge, so the other end is the first
// active node in that direction.

/// Directions of edges, starting at the end that comes first in z, then y, then x.
inline constexpr std::size_t kEdgeDirections = 13;
/// The directions as steps of the coordinates of a LocalNode; those along the axes come first.
inline constexpr std::array<LocalNode, kEdgeDirections> kDirectionSteps = [] {
    std::array<LocalNode, kEdgeDirections> steps{1U, 1U << kCoordinateShift[1],
                                                 1U << kCoordinateShift[2]};
    std::size_t n = 3;
    for (int z = 0; z <= 1; ++z) {
        for (int y = -1; y <= 1; ++y) {
            for (int x = -1; x <= 1; ++x) {
                const bool is_first = z > 0 || (z == 0 && (y > 0 || (y == 0 && x > 0)));
                if (is_first && x * x + y * y + z * z > 1) {
                    // Unsigned steps: they borrow from the fields above, like LocalNode's
                    // differences.
                    steps.at(n++) = static_cast<LocalNode>(x) +
                                    (static_cast<LocalNode>(y) << kCoordinateShift[1]) +
                                    (static_cast<LocalNode>(z) << kCoordinateShift[2]);
                }
            }
        }
    }
    return steps;
}();
/// The direction of a step.
constexpr std::size_t direction_key(LocalNode step) {
    // After the addition each coordinate is 0, 1 or 2.
    const LocalNode t = step + 1U + (1U << kCoordinateShift[1]);
    return (t & 3U) | (t >> (kCoordinateShift[1] - 2) & 12U) |
           (t >> (kCoordinateShift[2] - 4) & 16U);
}
inline constexpr std::array<std::uint8_t, 32> kDirectionOfKey = [] {
    std::array<std::uint8_t, 32> of{};
    for (std::size_t d = 0; d < kEdgeDirections; ++d) {
        of.at(direction_key(kDirectionSteps.at(d))) = static_cast<std::uint8_t>(d);
    }
    return of;
}();

template <bool Coefficient, class Real, int D>
class BlockWeights {
  public:
    explicit BlockWeights(const BlockCommon<Real, D>& common)
        : common_(common),
          nodes_(common),
          size_(nodes_.block.layout.size()),
          weights_(kEdgeDirections * size_),
          mass_(size_),
          index_(size_) {}

    /// Appends the block's rows and edges, and adds its part of the diagonals of the lumped mass
    /// matrix and of the stiffness matrix. `elements`: bits of this block's walks.
    void operator()(const Int3& corner, std::uint32_t elements, std::span<Real> mass,
                    std::span<Real> diagonal, EdgeWeights<Real>& out) {
        nodes_.gather(corner);
        std::fill(weights_.begin(), weights_.end(), Real{0});
        std::fill(mass_.begin(), mass_.end(), Real{0});
        if constexpr (D == 3) {
            finest();
        }
        AddsLeaf add{common_, nodes_.block, weights_, mass_, size_};
        nodes_.visit(elements, add);
        number(out);
        collect(out);
        scatter(mass, diagonal, out);
    }

  private:
    struct AddsLeaf {
        const BlockCommon<Real, D>& common;
        const LocalBlock<Real, D>& block;
        std::vector<Real>& weights;
        std::vector<Real>& mass;
        std::size_t size;

        template <int Kind>
        void operator()(const BlockVertices<D>& v, const ElementAxes<D>& axes, int level) {
            const ElementTerms<Real>& t =
                common.terms[static_cast<std::size_t>(level)][static_cast<std::size_t>(Kind)];
            std::array<Real, static_cast<std::size_t>(D)> inverse;
            for (std::size_t j = 0; j < D; ++j) {
                inverse[j] = t.inverse[static_cast<std::size_t>(axes[j])];
            }
            Real scale = t.stiffness;
            if constexpr (Coefficient) {
                std::array<Real, static_cast<std::size_t>(D) + 1> stopping;
                for (std::size_t i = 0; i <= D; ++i) {
                    stopping[i] = block.stopping[v[i].at];
                }
                scale /= 1 + gradient_squared<D, Kind>(stopping, inverse) * t.inverse_lambda;
            }
            // Sorted by node, with positions: an edge belongs to its smaller end.
            std::array<std::uint64_t, static_cast<std::size_t>(D) + 1> ordered;
            for (std::size_t i = 0; i <= D; ++i) {
                ordered[i] = std::uint64_t{v[i].node} << 32U | v[i].at;
            }
            for_couplings<D, Kind>(scale, inverse, [&]<std::size_t I, std::size_t J>(Real weight) {
                // Midpoints are half an edge away.
                const int length = level - (J > D - Kind ? 1 : 0);
                const std::uint64_t low = std::min(ordered[I], ordered[J]);
                const std::uint64_t high = std::max(ordered[I], ordered[J]);
                // A negative x or y borrows from above; a shift preserves that.
                const auto step = static_cast<LocalNode>((high >> 32U) - (low >> 32U));
                const std::size_t direction =
                    kDirectionOfKey[direction_key(step >> static_cast<unsigned>(length))];
                weights[direction * size + (low & 0xFFFFFFFFU)] += weight;
            });
            for (const BlockVertex& x : v) {
                mass[x.at] += t.volume / (D + 1);
            }
        }
    };

    void finest() {
        const ElementTerms<Real>& t = common_.terms[0][0];
        const FinestTerms<Real> terms{t.volume, t.stiffness, t.inverse, t.inverse_lambda};
        const LocalBlock<Real, D>& block = nodes_.block;
        nodes_.for_finest_cells([&](std::int64_t y, std::int64_t z, const auto& first,
                                    std::uint32_t parity, const Real* there) {
            const auto rows = [&](const std::vector<Real>& a) {
                return corner_rows<NodeRow<Real>, D>(a.data(), first, parity);
            };
            // An edge belongs to its lower end.
            constexpr std::uint32_t kOdd = BlockLayout<D>::kEven;
            const std::uint32_t lower_x = parity == 0 ? 0 : kOdd;
            const auto y_odd = static_cast<std::size_t>(y & 1);
            const auto z_odd = static_cast<std::size_t>(z & 1);
            Real* const along_x = weights_.data() + lower_x;
            Real* const along_y = weights_.data() + size_;
            Real* const along_z = weights_.data() + 2 * size_;
            EdgeRows<Real> edges;
            for (std::size_t r = 0; r < 4; ++r) {
                const std::size_t x_odd = r & 1U;
                const std::uint32_t in_row = x_odd != 0 ? kOdd : parity;
                edges[0][r] = along_x + first[r];
                edges[1][r] = along_y + first[y_odd + 2 * (r >> 1U)] + in_row;
                edges[2][r] = along_z + first[(r >> 1U) + 2 * z_odd] + in_row;
            }
            const auto sums = corner_rows<SumRow<Real>, D>(mass_.data(), first, parity);
            add_finest_weights(Coefficient, terms, rows(block.stopping), rows(block.active), there,
                               edges, sums);
        });
    }

    /// The rows with active nodes, and those nodes in order.
    void number(EdgeWeights<Real>& out) {
        own_.clear();
        nodes_.for_rows([&](std::uint32_t first, const Int3& p, std::int64_t count) {
            const std::size_t before = own_.size();
            const LocalNode row = local_node(p - nodes_.block.corner);
            common_.nodes->for_row(p, count, [&](std::int64_t x, std::uint64_t number) {
                if (own_.size() == before) {
                    out.row_first.push_back(number);
                }
                const auto local_x = static_cast<std::uint32_t>(x - p.x);
                const std::uint32_t at = first + BlockLayout<D>::in_row(local_x);
                index_[at] = static_cast<std::uint16_t>(own_.size());
                own_.push_back({row + local_x, at});
            });
            if (own_.size() > before) {
                out.row_count.push_back(static_cast<std::uint16_t>(own_.size() - before));
            }
        });
    }

    void collect(EdgeWeights<Real>& out) {
        const LocalBlock<Real, D>& block = nodes_.block;
        found_.resize(own_.size());
        for (std::size_t d = 0; d < kEdgeDirections; ++d) {
            const Real* const weights = weights_.data() + d * size_;
            std::size_t count = 0;
            for (std::size_t i = 0; i < own_.size(); ++i) {
                found_[count] = static_cast<std::uint16_t>(i);
                count += weights[own_[i].at] != 0 ? 1 : 0;
            }
            for (std::size_t n = 0; n < count; ++n) {
                const BlockVertex& from = own_[found_[n]];
                LocalNode step = kDirectionSteps[d];
                std::uint32_t to = block.layout.at(from.node + step);
                while (block.active[to] == 0) {
                    step += step;
                    to = block.layout.at(from.node + step);
                }
                out.ends.push_back({found_[n], index_[to]});
                out.weight.push_back(weights[from.at]);
            }
        }
    }

    void scatter(std::span<Real> mass, std::span<Real> diagonal, const EdgeWeights<Real>& out) {
        sum_.assign(own_.size(), Real{0});
        for (std::size_t e = 0; e < out.weight.size(); ++e) {
            sum_[out.ends[e].from] += out.weight[e];
            sum_[out.ends[e].to] += out.weight[e];
        }
        std::size_t i = 0;
        for (std::size_t row = 0; row < out.row_first.size(); ++row) {
            for (std::uint64_t n = 0; n < out.row_count[row]; ++n, ++i) {
                mass[out.row_first[row] + n] += mass_[own_[i].at];
                diagonal[out.row_first[row] + n] += sum_[i];
            }
        }
    }

    const BlockCommon<Real, D>& common_;
    BlockNodes<false, Coefficient, Real, D> nodes_;
    std::size_t size_;           ///< size of an array over the block's nodes
    std::vector<Real> weights_;  ///< by direction
    std::vector<Real> mass_;
    std::vector<std::uint16_t> index_;  ///< of active nodes, among them
    std::vector<BlockVertex> own_;      ///< the active nodes
    std::vector<std::uint16_t> found_;
    std::vector<Real> sum_;
};

}  // namespace isonest::detail
