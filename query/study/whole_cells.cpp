#include "query/study/whole_cells.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "query/traverse/hexahedra/hanging_node.h"
#include "query/view/node_sampler.h"

namespace isonest::detail {
namespace {

bool is_refined(const WholeLattice& whole, int level, const Int3& cell, double threshold) {
    return level > 0 && static_cast<double>(
                            whole.indicator(whole.lattice().centre_of(level, cell))) >= threshold;
}

void visit(const WholeLattice& whole, int level, const Int3& cell, double threshold,
           VisitCounts& counts) {
    ++counts.visited;
    if (!is_refined(whole, level, cell, threshold)) {
        ++counts.leaves;
        return;
    }
    const Int3 first = cell * 2;
    const Int3 count = min(first + Int3{2, 2, 2}, whole.lattice().elements_at(level - 1)) - first;
    for (std::int64_t i = 0; i < count.product(); ++i) {
        visit(whole, level - 1, first + count.unlinear(i), threshold, counts);
    }
}

}  // namespace

double load_cell_numbers(WholeLattice& whole, ChunkCache& cache, Field field, Progress& progress) {
    const Lattice& lattice = whole.lattice();
    double largest = 0;
    for (int level = 1; level <= lattice.top(); ++level) {
        const Int3 cells = lattice.elements_at(level);
        std::vector<double> of_layer(static_cast<std::size_t>(cells.z), 0);
        tbb::parallel_for(std::int64_t{0}, cells.z, [&](std::int64_t z) {
            progress.check();
            NodeSampler sampler(cache);
            double most = 0;
            for (std::int64_t i = 0; i < cells.x * cells.y; ++i) {
                const Int3 centre = lattice.centre_of(level, {i % cells.x, i / cells.x, z});
                const double number = sampler.indicator(centre, field);
                whole.set_indicator(centre, static_cast<float>(number));
                most = std::isfinite(number) ? std::max(most, number) : most;
            }
            of_layer[static_cast<std::size_t>(z)] = most;
        });
        largest = std::max(largest, *std::max_element(of_layer.begin(), of_layer.end()));
    }
    return largest;
}

std::uint64_t project_on_cells(WholeLattice& whole, double threshold) {
    const auto stops = [&](int level, const Int3& cell) {
        return !is_refined(whole, level, cell, threshold);
    };
    const auto projected = [&](const Int3& p) { return whole.projected(p); };
    return whole.project_by([&](const Int3& p, const NodeInfo& node) {
        return hangs(whole.lattice(), p, node, stops)
                   ? std::optional(mean_of_corners(p, node, projected))
                   : std::nullopt;
    });
}

VisitCounts count_cells(const WholeLattice& whole, double threshold) {
    VisitCounts counts;
    const Lattice& lattice = whole.lattice();
    const Int3 roots = lattice.elements_at(lattice.top());
    for (std::int64_t i = 0; i < roots.product(); ++i) {
        visit(whole, lattice.top(), roots.unlinear(i), threshold, counts);
    }
    return counts;
}

}  // namespace isonest::detail
