#include "query/study/study.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include <isonest/error.h>

#include "query/traverse/each_leaf.h"
#include "query/traverse/planar.h"
#include "query/traverse/traversal_budget.h"
#include "query/view/blocks.h"
#include "query/view/indicator_box.h"
#include "query/view/node_sampler.h"
#include "store/base/memory_budget.h"
#include "store/base/workers.h"
#include "store/container/gather.h"

namespace isonest::detail {
namespace {

constexpr std::uint64_t kBytesPerNode = 2 * sizeof(double) + sizeof(float);

/// The nodes that elements reach, those beyond the volume too. Level L's cubes tile the volume, so
/// what they reach grows with L: there are few nodes beyond what level 1's reach, on coarse levels
/// alone.
class NodeNumbers {
  public:
    explicit NodeNumbers(const Lattice& lattice) {
        for (int level = std::min(1, lattice.top()); level <= lattice.top(); ++level) {
            const Int3 last = lattice.cells_at(level) * (std::int64_t{1} << level);
            if (regions_.empty() || last != regions_.back().last) {
                const std::int64_t scale = level > 0 ? std::int64_t{1} << (level - 1) : 1;
                const Int3 size =
                    Int3{last.x / scale, last.y / scale, last.z / scale} + Int3{1, 1, 1};
                regions_.push_back({last, size, scale, count_});
                count_ += static_cast<std::size_t>(size.product());
            }
        }
    }
    [[nodiscard]] std::size_t count() const { return count_; }
    /// REQUIRES: an element reaches the node.
    [[nodiscard]] std::size_t of(const Int3& p) const {
        const Region* region = regions_.data();
        while (max(p, region->last) != region->last) {
            ++region;
        }
        return region->first +
               static_cast<std::size_t>(region->size.linear(
                   {p.x / region->scale, p.y / region->scale, p.z / region->scale}));
    }
    /// The size of the dense lattice of all nodes that level 1's cubes reach.
    [[nodiscard]] const Int3& dense() const { return regions_.front().size; }
    /// Calls f(p) for all nodes beyond.
    template <class F>
    void for_others(const F& f) const {
        for (std::size_t r = 1; r < regions_.size(); ++r) {
            const Int3& nearer = regions_[r - 1].last;
            for (std::int64_t i = 0; i < regions_[r].size.product(); ++i) {
                const Int3 p = regions_[r].size.unlinear(i) * regions_[r].scale;
                if (max(p, nearer) != nearer) {
                    f(p);
                }
            }
        }
    }

  private:
    /// Multiples of `scale` up to `last`.
    struct Region {
        Int3 last;
        Int3 size;
        std::int64_t scale;
        std::size_t first;
    };
    std::vector<Region> regions_;
    std::size_t count_ = 0;
};

/// U, P U and an indicator in all those nodes.
class WholeLattice {
  public:
    explicit WholeLattice(const StoreLayout& layout)
        : layout_(layout),
          lattice_(layout.lattice()),
          number_(lattice_),
          exact_(number_.count()),
          projected_(number_.count()),
          eta_(number_.count()) {}

    static std::uint64_t heap(const StoreLayout& layout) {
        return NodeNumbers(layout.lattice()).count() * kBytesPerNode;
    }

    void load_values(ChunkCache& cache) {
        const ArrayInfo& array = layout_.array(0, Field::values);
        dispatch(layout_.header().type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            const auto block = [&](const Int3& lo, const Int3& size) {
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

    /// Returns the largest finite value.
    double load_indicator(ChunkCache& cache, Field field, Progress& progress) {
        const Int3 chunk = layout_.array(0, Field::values).chunk;
        const Int3 grid = ceil_div(number_.dense(), chunk);
        std::vector<double> largest(static_cast<std::size_t>(grid.product()), 0);
        const auto set = [&](const Int3& p, double eta, double& most) {
            eta_[at(p)] = static_cast<float>(eta);
            most = std::isfinite(eta) ? std::max(most, eta) : most;
        };
        tbb::parallel_for(std::int64_t{0}, grid.product(), [&](std::int64_t c) {
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

    /// P U in all nodes, from coarse to fine: U where the mesh is refined, else the mean of the
    /// ends of the refinement edge.
    void project(double threshold) {
        // The corners first, by themselves: nodes in other planes are projected from them.
        const Int3 far = lattice_.cells_at(lattice_.top()) * (std::int64_t{1} << lattice_.top());
        for (std::int64_t i = 0; i < 8; ++i) {
            const Int3 o = Int3{2, 2, 2}.unlinear(i);
            const Int3 corner{o.x * far.x, o.y * far.y, o.z * far.z};
            projected_[at(corner)] = exact_[at(corner)];
        }
        for (int level = lattice_.top(); level >= 1; --level) {
            const std::int64_t scale = std::int64_t{1} << (level - 1);
            const Int3 size = lattice_.cells_at(level) * 2 + Int3{1, 1, 1};
            tbb::parallel_for(std::int64_t{0}, size.z, [&](std::int64_t z) {
                for (std::int64_t i = 0; i < size.x * size.y; ++i) {
                    const Int3 p = Int3{i % size.x, i / size.x, z} * scale;
                    const NodeInfo node = describe_node(p, lattice_.top());
                    if (node.scale == scale) {
                        project_at(p, node, threshold);
                    }
                }
            });
        }
    }

    /// The elements of the mesh: those too that reach out of the volume.
    void count(double threshold, int threads, StudyRow& row) const {
        VisitCounts counts;
        switch (lattice_.dimension()) {
            case 1:
                counts = count_elements<1>(threshold, threads);
                break;
            case 2:
                counts = count_elements<2>(threshold, threads);
                break;
            case 3:
                counts = count_elements<3>(threshold, threads);
                break;
            default:
                counts.visited = counts.leaves = 1;  // a single node
        }
        row.visited = counts.visited;
        row.leaves = counts.leaves;
    }

    void measure(double range, StudyRow& row) const {
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
                    row.linf = std::max(row.linf, d);
                }
            }
        }
        row.l1 = weight_sum > 0 ? sum1 / weight_sum : 0;
        row.l2 = weight_sum > 0 ? std::sqrt(sum2 / weight_sum) : 0;
    }

  private:
    [[nodiscard]] std::size_t at(const Int3& p) const { return number_.of(p); }
    void project_at(const Int3& p, const NodeInfo& node, double threshold) {
        const bool refined = static_cast<double>(eta_[at(p)]) >= threshold;
        projected_[at(p)] =
            refined ? exact_[at(p)] : (projected_[at(node.end0)] + projected_[at(node.end1)]) / 2;
    }

    /// What AdaptTraverse is given: the arrays; cubes that begin inside the volume; the threshold.
    struct Numbers {
        const WholeLattice* whole;
        [[nodiscard]] double value(const Int3& p, int /*level*/) const {
            return whole->exact_[whole->at(p)];
        }
        [[nodiscard]] double indicator(const Int3& p, Field /*field*/) const {
            return static_cast<double>(whole->eta_[whole->at(p)]);
        }
    };
    struct CubesOfVolume {
        Int3 last;  ///< node
        template <int D>
        [[nodiscard]] Overlap overlap(const Element<D>& t) const {
            const Int3 begin = t.bounds().first;
            const bool outside = t.kind == 0 && ((begin.x >= last.x && last.x > 0) ||
                                                 (begin.y >= last.y && last.y > 0) ||
                                                 (begin.z >= last.z && last.z > 0));
            return outside ? Overlap::outside : Overlap::inside;
        }
    };
    struct BelowThreshold {
        double threshold;
        [[nodiscard]] static std::optional<Field> field() { return Field::linf_bar; }
        template <int D>
        [[nodiscard]] bool stops(const Element<D>& /*t*/, double eta) const {
            return !(eta >= threshold);
        }
    };
    template <int D>
    [[nodiscard]] VisitCounts count_elements(double threshold, int threads) const {
        return for_each_leaf<D>(lattice_, Numbers{this},
                                CubesOfVolume{lattice_.nodes() - Int3{1, 1, 1}},
                                BelowThreshold{threshold}, {}, threads, silent_progress());
    }

    const StoreLayout& layout_;
    const Lattice& lattice_;
    NodeNumbers number_;
    std::vector<double> exact_;
    std::vector<double> projected_;
    std::vector<float> eta_;
};

/// The extraction of an isosurface (isolines) with this stop test.
TraversalQuery surface_query(const StoreReader& store, double iso, Field stop, double threshold) {
    const StoreHeader& header = store.layout().header();
    TraversalQuery query;
    query.iso = iso;
    query.stop = stop;
    query.tolerance = Tolerance(threshold, {}, {}, header.spacing, header.origin);
    for (const Field field :
         {Field::grad_linf_plus, Field::linf_plus, Field::deviation_plus, Field::deviation_bar}) {
        query.bound = store.layout().has(field) ? field : query.bound;
    }
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
        const bool flat = header.nodes[axis] == 1;
        query.box.lo[static_cast<std::size_t>(axis)] = flat ? -kInfinity : 0;
        query.box.hi[static_cast<std::size_t>(axis)] =
            flat ? kInfinity : static_cast<double>(header.nodes[axis] - 1);
    }
    return query;
}

/// What that visits.
void count_surface(ChunkCache& cache, const TraversalQuery& query, std::size_t part_vertices,
                   StudyRow& row) {
    const PartSink nowhere = [](std::uint64_t, const MeshPart&) {};
    const bool planar = cache.source().layout().lattice().dimension() == 2;
    const TraversalCounts counts =
        planar ? traverse_planar(cache, query, PlanarKind::isolines, part_vertices, nowhere,
                                 silent_progress())
               : traverse(cache, query, part_vertices, nowhere, silent_progress());
    row.iso_visited = counts.visited;
    row.iso_leaves = counts.leaves;
}

/// How the memory is shared; fewer threads run where there is little.
struct Shares {
    int threads = 1;
    std::uint64_t cache = 0;
    std::size_t part_vertices = 0;
};

Shares share(const StoreReader& store, const StudyOptions& options) {
    const StoreLayout& layout = store.layout();
    const std::uint64_t nodes = WholeLattice::heap(layout);
    const std::uint64_t largest = largest_chunk_bytes(layout);
    // One chunk is held, one is in the cache besides.
    const std::uint64_t each = decode_heap(largest) + 2 * largest + kIndicatorBoxHeap;
    std::uint64_t least = each;
    for (const Field field : options.fields) {
        if (options.iso) {
            const TraversalQuery query = surface_query(store, *options.iso, field, 0);
            least = std::max(least, least_heap(store, query, nullptr));
        }
    }
    Shares shares;
    require_memory(store.path().string(), options.memory, kLibraryHeap + nodes + least,
                   "a study of this volume", {{RemedyKind::smaller_box}});
    const std::uint64_t usable = options.memory - kLibraryHeap - nodes;
    const auto threads = std::clamp<std::uint64_t>(
        usable / each, 1, static_cast<std::uint64_t>(Workers::count_of(options.threads)));
    shares.threads = static_cast<int>(threads);
    shares.cache = usable - threads * (each - 2 * largest);
    if (options.iso) {
        for (const Field field : options.fields) {
            const TraversalBudget budget =
                share_memory(store, surface_query(store, *options.iso, field, 0), nullptr,
                             options.memory, nodes, shares.threads, false);
            shares = {budget.threads, std::min(shares.cache, budget.cache), budget.part_vertices};
        }
    }
    return shares;
}

}  // namespace

Study study(const StoreReader& store, const StudyOptions& options, Progress& progress) {
    const StoreLayout& layout = store.layout();
    for (const Field field : options.fields) {
        if (is_of_cells(field)) {
            throw Error(ErrorKind::invalid_argument, {store.path().string()},
                        fmt::format("a study compares fields of nodes; {} is one of hexahedral "
                                    "cells",
                                    name_of(field)));
        }
        static_cast<void>(layout.array(std::min(1, layout.lattice().top()), field));
    }
    if (options.steps < 2 || !(options.least > 0) || !(options.least < 1)) {
        throw Error(ErrorKind::invalid_argument,
                    "a study needs at least 2 thresholds, and the least one between 0 and 1");
    }
    const Shares shares = share(store, options);
    Study result;
    Workers(shares.threads).execute([&] {
        WholeLattice whole(layout);
        ChunkCache cache(store, shares.cache);
        whole.load_values(cache);
        const double range = store.max_value() - store.min_value();
        StudyRow finest;
        whole.count(-1, options.threads, finest);
        result.all_elements = finest.leaves;
        for (const Field field : options.fields) {
            const double largest = whole.load_indicator(cache, field, progress);
            progress.begin(std::string(name_of(field)), static_cast<std::uint64_t>(options.steps),
                           "thresholds");
            for (int step = 0; step < options.steps; ++step) {
                progress.check();
                StudyRow row;
                row.field = field;
                row.threshold = std::pow(options.least, static_cast<double>(step) /
                                                            static_cast<double>(options.steps - 1));
                const double threshold = row.threshold * largest;
                whole.project(threshold);
                whole.count(threshold, options.threads, row);
                whole.measure(range > 0 ? range : 1, row);
                if (options.iso) {
                    count_surface(cache, surface_query(store, *options.iso, field, threshold),
                                  shares.part_vertices, row);
                }
                result.rows.push_back(row);
                progress.advance(1);
            }
        }
    });
    return result;
}

}  // namespace isonest::detail
