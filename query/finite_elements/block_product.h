// One block's part of z = A w: its nodes are gathered, its leaves visited, the sums scattered.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "query/finite_elements/block_nodes.h"

namespace isonest::detail {

template <ElementWork Work, bool Coefficient, class Real, int D>
class BlockProduct {
  public:
    BlockProduct(const BlockCommon<Real, D>& common, std::span<Real> out)
        : common_(common), out_(out), nodes_(common), sum_(nodes_.block.layout.size()) {}

    /// `elements`: bits of the walks that are this block's.
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

}  // namespace isonest::detail
