#include "query/study.h"

#include <fmt/format.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "query/node_sampler.h"
#include "query/planar.h"
#include "query/traversal.h"
#include "store/error.h"
#include "store/gather.h"
#include "store/workers.h"

namespace isonest {
namespace {

constexpr std::uint64_t kBytesPerNode = 2 * sizeof(double) + sizeof(float);

/// All nodes of the lattice, those beyond the volume too: elements reach there.
class WholeLattice {
  public:
    WholeLattice(const StoreReader& store, const StudyOptions& options)
        : layout_(store.layout()), lattice_(layout_.lattice()) {
        const std::int64_t edge = std::int64_t{1} << lattice_.top();
        size_ = lattice_.cells_at(lattice_.top()) * edge + Int3{1, 1, 1};
        const auto need = static_cast<std::uint64_t>(size_.product()) * kBytesPerNode;
        if (need > options.memory / 4 * 3) {
            throw Error(ErrorKind::limit,
                        fmt::format("{}: a study of {} x {} x {} nodes needs a memory of {} MiB: "
                                    "give --memory, or study a crop of the volume",
                                    store.path().string(), size_.x, size_.y, size_.z,
                                    (need * 4 / 3 >> 20U) + 1));
        }
        const auto count = static_cast<std::size_t>(size_.product());
        exact_.resize(count);
        projected_.resize(count);
        eta_.resize(count);
    }

    void load_values(ChunkCache& cache) {
        dispatch(layout_.header().type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            Box<T> plane({0, 0, 0}, {size_.x, size_.y, 1});
            for (std::int64_t z = 0; z < size_.z; ++z) {
                plane.lo.z = z;
                gather_values(cache, layout_.array(0, Field::values), plane);
                std::copy(plane.data.begin(), plane.data.end(),
                          exact_.begin() + static_cast<std::ptrdiff_t>(z * size_.x * size_.y));
            }
        });
    }

    /// Returns the largest finite value.
    double load_indicator(ChunkCache& cache, Field field, Progress& progress) {
        std::vector<double> largest(static_cast<std::size_t>(size_.z), 0);
        tbb::parallel_for(tbb::blocked_range<std::int64_t>(0, size_.z), [&](const auto& planes) {
            NodeSampler sampler(cache);
            for (std::int64_t z = planes.begin(); z < planes.end(); ++z) {
                progress.check();
                for (std::int64_t i = 0; i < size_.x * size_.y; ++i) {
                    const Int3 p{i % size_.x, i / size_.x, z};
                    const double eta = exists(p) ? sampler.indicator(p, field) : 0;
                    eta_[at(p)] = static_cast<float>(eta);
                    if (std::isfinite(eta)) {
                        double& most = largest[static_cast<std::size_t>(z)];
                        most = std::max(most, eta);
                    }
                }
            }
        });
        return *std::max_element(largest.begin(), largest.end());
    }

    /// P U in all nodes, from coarse to fine: U where the mesh is refined, else the mean of the
    /// ends of the refinement edge.
    void project(double threshold, StudyRow& row) {
        const int dimension = lattice_.dimension();
        constexpr std::array<std::uint64_t, 4> kInCube{1, 1, 2, 6};
        const Int3 macros = lattice_.elements_at(lattice_.top());
        const std::uint64_t first = kInCube.at(static_cast<std::size_t>(dimension)) *
                                    static_cast<std::uint64_t>(macros.product());
        std::vector<std::uint64_t> added(static_cast<std::size_t>(size_.z));
        std::vector<std::uint64_t> visited(static_cast<std::size_t>(size_.z));
        // The corners first, by themselves: nodes in other planes are projected from them.
        for (std::int64_t i = 0; i < 8; ++i) {
            const Int3 o = Int3{2, 2, 2}.unlinear(i);
            const Int3 corner{o.x * (size_.x - 1), o.y * (size_.y - 1), o.z * (size_.z - 1)};
            projected_[at(corner)] = exact_[at(corner)];
        }
        for (int level = lattice_.top(); level >= 1; --level) {
            tbb::parallel_for(std::int64_t{0}, size_.z, [&](std::int64_t z) {
                const std::int64_t stride = std::int64_t{1} << (level - 1);
                if (z % stride != 0) {
                    return;
                }
                const auto plane = static_cast<std::size_t>(z);
                for (std::int64_t y = 0; y < size_.y; y += stride) {
                    for (std::int64_t x = 0; x < size_.x; x += stride) {
                        const Int3 p{x, y, z};
                        const NodeInfo node = describe_node(p, lattice_.top());
                        if (node.scale == stride) {
                            refine(p, node, level, threshold, added[plane], visited[plane]);
                        }
                    }
                }
            });
        }
        row.leaves = first;
        row.visited = first;
        for (std::size_t z = 0; z < added.size(); ++z) {
            row.leaves += added[z];
            row.visited += visited[z];
        }
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
    [[nodiscard]] std::size_t at(const Int3& p) const {
        return static_cast<std::size_t>(size_.linear(p));
    }
    /// Whether an element refines at the node: whether it is one of the lattice of its level.
    [[nodiscard]] bool exists(const Int3& p) const {
        const NodeInfo node = describe_node(p, lattice_.top());
        if (node.scale == 0) {
            return false;
        }
        const Int3 last = lattice_.cells_at(node.level()) * (2 * node.scale);
        return max(p, last) == last;
    }
    void refine(const Int3& p, const NodeInfo& node, int level, double threshold,
                std::uint64_t& added, std::uint64_t& visited) {
        if (!(static_cast<double>(eta_[at(p)]) >= threshold) || !exists(p)) {
            projected_[at(p)] = (projected_[at(node.end0)] + projected_[at(node.end1)]) / 2;
            return;
        }
        projected_[at(p)] = exact_[at(p)];
        const std::uint64_t parents = elements_at(p, node, level);
        std::uint64_t children = 2 * parents;
        if (node.kind == NodeKind::edge) {
            // One in every square, or two in every cube, of the finer level around the midpoint.
            children = (lattice_.dimension() == 3 ? 2U : 1U) * cubes_around(p, level - 1);
        }
        added += children - parents;
        visited += children;
    }
    /// Cubes (squares, edges) of the level that have node p, in them or as a border's node.
    [[nodiscard]] std::uint64_t cubes_around(const Int3& p, int level) const {
        const std::int64_t edge = std::int64_t{1} << level;
        const Int3 cells = lattice_.cells_at(level);
        std::uint64_t count = 1;
        for (int axis = 0; axis < 3; ++axis) {
            if (cells[axis] == 0) {
                continue;
            }
            const std::int64_t i = p[axis] / edge;
            const bool before = p[axis] % edge == 0 && i > 0 && i <= cells[axis];
            count *= (before ? 1U : 0U) + (i < cells[axis] ? 1U : 0U);
        }
        return count;
    }
    /// Elements of the level that refine at the node.
    [[nodiscard]] std::uint64_t elements_at(const Int3& p, const NodeInfo& node, int level) const {
        const int dimension = lattice_.dimension();
        const std::uint64_t cubes = cubes_around(p, level);
        if (node.kind == NodeKind::centre) {
            return 6;
        }
        if (node.kind == NodeKind::face) {
            return 2 * cubes;  // in a plane: the square's two halves
        }
        return (dimension == 3 ? 2 : 1) * cubes;
    }

    const StoreLayout& layout_;
    const Lattice& lattice_;
    Int3 size_;
    std::vector<double> exact_;
    std::vector<double> projected_;
    std::vector<float> eta_;
};

/// What the extraction of an isosurface (isolines) visits with this stop test.
void count_surface(const StoreReader& store, ChunkCache& cache, double iso, double threshold,
                   StudyRow& row) {
    const StoreHeader& header = store.layout().header();
    TraversalQuery query;
    query.iso = iso;
    query.stop = row.field;
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
    constexpr std::size_t kPart = 65536;
    const PartSink nowhere = [](std::uint64_t, const MeshPart&) {};
    const bool planar = store.layout().lattice().dimension() == 2;
    const TraversalCounts counts =
        planar
            ? traverse_planar(cache, query, PlanarKind::isolines, kPart, nowhere, silent_progress())
            : traverse(cache, query, kPart, nowhere, silent_progress());
    row.iso_visited = counts.visited;
    row.iso_leaves = counts.leaves;
}

}  // namespace

Study study(const StoreReader& store, const StudyOptions& options, Progress& progress) {
    const StoreLayout& layout = store.layout();
    for (const Field field : options.fields) {
        static_cast<void>(layout.array(std::min(1, layout.lattice().top()), field));
    }
    if (options.steps < 2 || !(options.least > 0) || !(options.least < 1)) {
        throw Error(ErrorKind::invalid_argument,
                    "a study needs at least 2 thresholds, and the least one between 0 and 1");
    }
    Study result;
    Workers(options.threads).execute([&] {
        WholeLattice whole(store, options);
        ChunkCache cache(store, options.memory / 4);
        whole.load_values(cache);
        const double range = store.max_value() - store.min_value();
        StudyRow finest;
        whole.project(-1, finest);
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
                whole.project(threshold, row);
                whole.measure(range > 0 ? range : 1, row);
                if (options.iso) {
                    count_surface(store, cache, *options.iso, threshold, row);
                }
                result.rows.push_back(row);
                progress.advance(1);
            }
        }
    });
    return result;
}

}  // namespace isonest
