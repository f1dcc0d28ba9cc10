#include "query/study/whole_lattice.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "query/traverse/each_leaf.h"
#include "query/traverse/hexahedra/hex_projection.h"
#include "query/values/blocks.h"
#include "query/values/node_sampler.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kBytesPerNode = 2 * sizeof(double) + sizeof(float);

/// The cubes that start inside the volume.
struct CubesOfVolume {
    Int3 last;  ///< node
    template <class T>
    [[nodiscard]] Overlap overlap(const T& t) const {
        const Int3 begin = t.bounds().first;
        const bool outside = t.is_whole() && ((begin.x >= last.x && last.x > 0) ||
                                              (begin.y >= last.y && last.y > 0) ||
                                              (begin.z >= last.z && last.z > 0));
        return outside ? Overlap::outside : Overlap::inside;
    }
};

/// Those of which the plane cuts out an area; if a face is in the plane, only the cubes below.
struct CutByPlane {
    CubesOfVolume cubes;
    LatticePlane plane;

    [[nodiscard]] Overlap overlap(const Element<3>& t) const {
        if (cubes.overlap(t) == Overlap::outside) {
            return Overlap::outside;
        }
        int below = 0;
        int above = 0;
        for (const Int3& v : t.v) {
            const double distance = plane.distance(v);
            below += distance < 0 ? 1 : 0;
            above += distance > 0 ? 1 : 0;
        }
        const bool is_cut = below > 0 && (above > 0 || below == 1);
        return is_cut ? Overlap::inside : Overlap::outside;
    }
};

struct BelowThreshold {
    double threshold;
    [[nodiscard]] static std::optional<Field> field() { return Field::linf_bar; }
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
    [[nodiscard]] double indicator(const Int3& p, Field /*field*/) const {
        return static_cast<double>(whole->eta_[whole->at(p)]);
    }
};

WholeLattice::WholeLattice(const StoreLayout& layout)
    : layout_(layout),
      lattice_(layout.lattice()),
      number_(lattice_),
      exact_(number_.count()),
      projected_(number_.count()),
      eta_(number_.count()) {}

std::uint64_t WholeLattice::heap(const StoreLayout& layout) {
    return NodeIndex(layout.lattice()).count() * kBytesPerNode;
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
    const Int3 chunk = layout_.array(0, Field::values).chunk;
    const Int3 grid = ceil_div(number_.dense(), chunk);
    std::vector<double> largest(static_cast<std::size_t>(grid.product()), 0);
    const auto set = [&](const Int3& p, double eta, double& most) {
        eta_[at(p)] = static_cast<float>(eta);
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

VisitCounts WholeLattice::count(double threshold, const LatticePlane* plane, int threads) const {
    if (plane != nullptr) {
        const CutByPlane cut{{lattice_.nodes() - Int3{1, 1, 1}}, *plane};
        return for_each_leaf<3>(lattice_, Numbers{this}, cut, BelowThreshold{threshold}, {},
                                threads, silent_progress());
    }
    switch (lattice_.dimension()) {
        case 1:
            return count_elements<1>(threshold, threads);
        case 2:
            return count_elements<2>(threshold, threads);
        case 3:
            return count_elements<3>(threshold, threads);
        default: {
            VisitCounts counts;
            counts.visited = counts.leaves = 1;  // a single node
            return counts;
        }
    }
}

template <int D>
VisitCounts WholeLattice::count_elements(double threshold, int threads) const {
    return for_each_leaf<D>(lattice_, Numbers{this},
                            CubesOfVolume{lattice_.nodes() - Int3{1, 1, 1}},
                            BelowThreshold{threshold}, {}, threads, silent_progress());
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
