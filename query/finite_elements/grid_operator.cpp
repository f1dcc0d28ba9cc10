#include "query/finite_elements/grid_operator.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>

#include "query/finite_elements/conjugate_gradients.h"
#include "query/finite_elements/grid_operator_template.h"

namespace isonest::detail {
namespace {

template <class Real>
struct BlockVectors {
    std::vector<Real> w;
    std::vector<Real> sum;
};

template <class Real>
void add_block(const EdgeWeights<Real>& block, std::span<const Real> w, std::span<Real> out,
               BlockVectors<Real>& local) {
    std::size_t nodes = 0;
    for (std::size_t row = 0; row < block.row_first.size(); ++row) {
        const Real* const from = w.data() + block.row_first[row];
        const std::size_t count = block.row_count[row];
        if (local.w.size() < nodes + count) {
            local.w.resize(nodes + count);
        }
        for (std::size_t n = 0; n < count; ++n) {
            local.w[nodes + n] = from[n];
        }
        nodes += count;
    }
    local.sum.assign(nodes, Real{0});
    const Real* const value = local.w.data();
    Real* const sum = local.sum.data();
    const std::size_t edges = block.weight.size();
    for (std::size_t e = 0; e < edges; ++e) {
        const auto [i, j] = block.ends[e];
        const Real flux = block.weight[e] * (value[i] - value[j]);
        sum[i] += flux;
        sum[j] -= flux;
    }
    const Real* from = sum;
    for (std::size_t row = 0; row < block.row_first.size(); ++row) {
        Real* const to = out.data() + block.row_first[row];
        for (std::size_t n = 0; n < block.row_count[row]; ++n) {
            to[n] += *from++;
        }
    }
}

}  // namespace

template <class Real>
void GridMatrix<Real>::multiply(std::span<const Real> diagonal, std::span<const Real> w,
                                std::span<Real> out) const {
    for_parts(out.size(), [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            out[i] = diagonal.empty() ? Real{0} : diagonal[i] * w[i];
        }
    });
    for (const CoarseEdge& e : coarse_) {
        const Real flux = e.weight * (w[e.from] - w[e.to]);
        out[e.from] += flux;
        out[e.to] -= flux;
    }
    tbb::enumerable_thread_specific<BlockVectors<Real>> locals;
    for (const auto& same : blocks_) {
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, same.size()), [&](const auto& r) {
            BlockVectors<Real>& local = locals.local();
            for (std::size_t i = r.begin(); i < r.end(); ++i) {
                add_block(same[i], w, out, local);
            }
        });
    }
}

template <class Real>
std::uint64_t GridMatrix<Real>::heap() const {
    std::uint64_t bytes = coarse_.size() * sizeof(CoarseEdge);
    for (const auto& same : blocks_) {
        for (const EdgeWeights<Real>& block : same) {
            bytes += sizeof(block) + block.heap();
        }
    }
    return bytes;
}

template <class Real>
std::uint64_t GridMatrix<Real>::edges() const {
    std::uint64_t edges = coarse_.size();
    for (const auto& same : blocks_) {
        for (const EdgeWeights<Real>& block : same) {
            edges += block.weight.size();
        }
    }
    return edges;
}

template class GridMatrix<float>;
template class GridMatrix<double>;

template class GridOperator<float>;
template class GridOperator<double>;

}  // namespace isonest::detail
