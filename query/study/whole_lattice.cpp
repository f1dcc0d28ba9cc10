#include "query/study/whole_lattice.h"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <optional>
#include <vector>

#include "query/traverse/each_leaf.h"
#include "query/traverse/hexahedra/hex_projection.h"
#include "query/values/blocks.h"
#include "query/values/node_sampler.h"
#include "store/container/chunk_cache.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kBytesPerNode = 2 * sizeof(double) + sizeof(float);

/// The cubes that start inside the volume. A coarse one may contain some that do not.
struct CubesOfVolume {
    Int3 last;  ///< node
    template <class T>
    [[nodiscard]] Overlap overlap(const T& t) const {
        const Int3 begin = t.bounds().first;
        const bool outside = t.is_whole() && ((begin.x >= last.x && last.x > 0) ||
                                              (begin.y >= last.y && last.y > 0) ||
                                              (begin.z >= last.z && last.z > 0));
        return outside ? Overlap::outside : Overlap::crossing;
    }
};

/// Selects the elements of which the plane cuts out an area; if a face is in the plane, only the
/// one below.
struct CutByPlane {
    LatticePlane plane;

    [[nodiscard]] static std::optional<Field> field() { return std::nullopt; }
    template <int D, class Numbers>
    [[nodiscard]] bool may_hold(const Element<D>& t, double /*number*/,
                                Numbers& /*numbers*/) const {
        int below = 0;
        int above = 0;
        for (const Int3& v : t.v) {
            const double distance = plane.distance(v);
            below += distance < 0 ? 1 : 0;
            above += distance > 0 ? 1 : 0;
        }
        return below > 0 && (above > 0 || below == 1);
    }
};

/// Stands for the field that is studied; it is not a bound.
constexpr Field kStudied = Field::linf_bar;

struct BelowThreshold {
    double threshold;
    [[nodiscard]] static std::optional<Field> field() { return kStudied; }
    template <class T, class Numbers>
    [[nodiscard]] bool stops(const T& /*t*/, double eta, Numbers& /*numbers*/) const {
        return !(eta >= threshold);
    }
};

}  // namespace

/// The numbers for AdaptTraverse.
struct WholeLattice::Numbers {
    const WholeLattice* whole;
    [[nodiscard]] double value(const Int3& p, int /*level*/) const {
        return whole->exact_[whole->at(p)];
    }
    [[nodiscard]] double indicator(const Int3& p, Field field) const {
        const std::vector<float>& numbers = field == kStudied ? whole->eta_ : whole->bound_;
        return static_cast<double>(numbers[whole->at(p)]);
    }
};

WholeLattice::WholeLattice(const StoreLayout& layout, std::optional<Field> bound)
    : layout_(layout),
      lattice_(layout.lattice()),
      number_(lattice_),
      exact_(number_.count()),
      projected_(number_.count()),
      eta_(number_.count()),
      bound_(bound ? number_.count() : 0),
      bound_field_(bound) {}

std::uint64_t WholeLattice::heap(const StoreLayout& layout, std::optional<Field> bound) {
    return NodeIndex(layout.lattice()).count() * (kBytesPerNode + (bound ? sizeof(float) : 0));
}

void WholeLattice::load_values(ChunkCache& cache) {
    const ArrayInfo& array = layout_.array(0, Field::values);
    const Int3 grid = ceil_div(number_.dense(), array.chunk);
    // Beyond the last chunk the nearest nodes are used.
    Prefetcher prefetcher(cache, 0, grid.product(),
                          [&](std::int64_t i, std::vector<WantedChunk>& chunks) {
                              const Int3 chunk = grid.unlinear(i);
                              if (array.has_chunk(chunk)) {
                                  chunks.push_back({&array, chunk});
                              }
                          });
    dispatch(layout_.header().type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        const auto block = [&](const Int3& lo, const Int3& size) {
            prefetcher.reach(grid.linear(array.chunk_of(lo)));
            Box<T> box(lo, size);
            gather_values(cache, array, box);
            for (std::int64_t i = 0; i < size.product(); ++i) {
                exact_[at(lo + size.unlinear(i))] =
                    static_cast<double>(box.data[static_cast<std::size_t>(i)]);
            }
        };
        for_each_block({0, 0, 0}, number_.dense(), array.chunk, block);
    });
    const Int3 last = lattice_.nodes() - Int3{1, 1, 1};
    number_.for_others([&](const Int3& p) { exact_[at(p)] = exact_[at(min(p, last))]; });
}

double WholeLattice::load_indicator(ChunkCache& cache, Field field, Progress& progress) {
    return load_numbers(cache, field, progress,
                        [&](const Int3& p, double eta) { eta_[at(p)] = static_cast<float>(eta); });
}

void WholeLattice::load_bound(ChunkCache& cache, Progress& progress) {
    assert(bound_field_);
    load_numbers(cache, *bound_field_, progress,
                 [&](const Int3& p, double beta) { bound_[at(p)] = round_up_to_float(beta); });
}

template <class Set>
double WholeLattice::load_numbers(ChunkCache& cache, Field field, Progress& progress,
                                  const Set& set_number) {
    const Int3 chunk = layout_.array(0, Field::values).chunk;
    const Int3 grid = ceil_div(number_.dense(), chunk);
    std::vector<double> largest(static_cast<std::size_t>(grid.product()), 0);
    const auto set = [&](const Int3& p, double eta, double& most) {
        set_number(p, eta);
        most = std::isfinite(eta) ? std::max(most, eta) : most;
    };
    const auto wanted = [&](std::int64_t c, std::vector<WantedChunk>& chunks) {
        const Int3 i = grid.unlinear(c);
        const Int3 first{i.x * chunk.x, i.y * chunk.y, i.z * chunk.z};
        want_box(layout_.array(0, Field::values), first - Int3{1, 1, 1},
                 first + chunk + Int3{1, 1, 1}, chunks);
        for (int level = 1; level <= lattice_.top(); ++level) {
            const std::int64_t stride = std::int64_t{1} << level;
            const Int3 end = first + chunk;
            want_box(layout_.array(level, field),
                     {first.x / stride, first.y / stride, first.z / stride},
                     {end.x / stride, end.y / stride, end.z / stride}, chunks);
        }
    };
    Prefetcher prefetcher(cache, 0, grid.product(), wanted);
    for_each_prefetched(cache.source(), prefetcher, 0, grid.product(), [&](std::int64_t c) {
        progress.check();
        const Int3 i = grid.unlinear(c);
        const Int3 first{i.x * chunk.x, i.y * chunk.y, i.z * chunk.z};
        const auto block = [&](const Int3& lo, const Int3& size) {
            Box<double> box(lo, size);
            fill_indicators(cache, field, 1, box);
            for (std::int64_t k = 0; k < size.product(); ++k) {
                set(lo + size.unlinear(k), box.data[static_cast<std::size_t>(k)],
                    largest[static_cast<std::size_t>(c)]);
            }
        };
        for_each_block(first, min(chunk, number_.dense() - first), chunk, block);
    });
    NodeSampler sampler(cache);
    number_.for_others(
        [&](const Int3& p) { set(p, sampler.indicator(p, field), largest.front()); });
    return *std::max_element(largest.begin(), largest.end());
}

/// U where the mesh is refined, otherwise the mean of the ends of the refinement edge.
std::uint64_t WholeLattice::project(double threshold) {
    return project_by([&](const Int3& p, const NodeInfo& node) -> std::optional<double> {
        const bool refined = static_cast<double>(eta_[at(p)]) >= threshold;
        return refined ? std::nullopt
                       : std::optional((projected_[at(node.end0)] + projected_[at(node.end1)]) / 2);
    });
}

template <int D, class Interest, class IsLeaf>
VisitCounts WholeLattice::traverse(double threshold, const Interest& interest,
                                   const IsLeaf& is_leaf) const {
    using Traversal =
        AdaptTraverse<Element<D>, const Numbers, CubesOfVolume, Interest, BelowThreshold>;
    const Numbers numbers{this};
    tbb::enumerable_thread_specific<VisitCounts> sums;
    using Elements = std::vector<Element<D>>;
    const auto visit = [&](const Elements& elements, int /*level*/, int below, Elements* left) {
        Traversal traversal(numbers, {lattice_.nodes() - Int3{1, 1, 1}}, interest, {threshold});
        std::uint64_t leaves = 0;
        auto count = [&](const Element<D>& leaf, double /*eta*/, Overlap /*where*/) {
            leaves += is_leaf(leaf) ? 1 : 0;
        };
        for (const Element<D>& t : elements) {
            if (left != nullptr) {
                traversal.above(t, below, count, *left);
            } else {
                traversal.subtree(t, count);
            }
        }
        VisitCounts counts = traversal.counts();
        counts.leaves = leaves;
        sums.local().add(counts);
    };
    each_leaf::visit_cube<D>(coarsest_of(lattice_, numbers, std::type_identity<Element<D>>()),
                             lattice_.top(), visit);
    VisitCounts sum;
    for (const VisitCounts& counts : sums) {
        sum.add(counts);
    }
    return sum;
}

template <class Interest, class IsLeaf>
VisitCounts WholeLattice::traverse(double threshold, const Interest& interest,
                                   const IsLeaf& is_leaf) const {
    switch (lattice_.dimension()) {
        case 1:
            return traverse<1>(threshold, interest, is_leaf);
        case 2:
            return traverse<2>(threshold, interest, is_leaf);
        case 3:
            return traverse<3>(threshold, interest, is_leaf);
        default:
            return {};
    }
}

VisitCounts WholeLattice::count(double threshold, const LatticePlane* plane) const {
    const auto all = [](const auto& /*leaf*/) { return true; };
    if (plane != nullptr) {
        return traverse<3>(threshold, CutByPlane{*plane}, all);
    }
    if (lattice_.dimension() == 0) {
        VisitCounts counts;
        counts.visited = counts.leaves = 1;  // a single node
        return counts;
    }
    return traverse(threshold, Everything{}, all);
}

VisitCounts WholeLattice::count_surface(double threshold, double iso) const {
    assert(bound_field_);
    return traverse(threshold, HoldsIsovalue{iso, *bound_field_, layout_.header().steps()},
                    [&](const auto& leaf) {
                        const auto [low, high] = leaf.range();
                        return leaf.is_complete() && low < iso && high >= iso;
                    });
}

VisitCounts WholeLattice::count_cells(double threshold) const {
    const Numbers numbers{this};
    AdaptTraverse<Cell, const Numbers, CubesOfVolume, Everything, BelowThreshold> traversal(
        numbers, {lattice_.nodes() - Int3{1, 1, 1}}, {}, {threshold});
    auto nothing = [](const Cell&, double, Overlap) {};
    for (const Cell& cell : traversal.roots(lattice_)) {
        traversal.subtree(cell, nothing);
    }
    return traversal.counts();
}

ErrorNorms WholeLattice::measure(double range) const {
    ErrorNorms norms;
    const Int3 n = lattice_.nodes();
    double weight_sum = 0;
    double sum1 = 0;
    double sum2 = 0;
    for (std::int64_t z = 0; z < n.z; ++z) {
        for (std::int64_t y = 0; y < n.y; ++y) {
            for (std::int64_t x = 0; x < n.x; ++x) {
                const Int3 p{x, y, z};
                const double u = exact_[at(p)];
                const double d = std::fabs(projected_[at(p)] - u) / range;
                if (!std::isfinite(u) || !std::isfinite(d)) {
                    continue;
                }
                double weight = 1;
                for (int axis = 0; axis < 3; ++axis) {
                    const bool border = p[axis] == 0 || p[axis] == n[axis] - 1;
                    weight *= border && n[axis] > 1 ? 0.5 : 1;
                }
                weight_sum += weight;
                sum1 += weight * d;
                sum2 += weight * d * d;
                norms.linf = std::max(norms.linf, d);
            }
        }
    }
    norms.l1 = weight_sum > 0 ? sum1 / weight_sum : 0;
    norms.l2 = weight_sum > 0 ? std::sqrt(sum2 / weight_sum) : 0;
    return norms;
}

namespace {

bool is_refined(const WholeLattice& whole, int level, const Int3& cell, double threshold) {
    return level > 0 && static_cast<double>(
                            whole.indicator(whole.lattice().centre_of(level, cell))) >= threshold;
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

}  // namespace isonest::detail
