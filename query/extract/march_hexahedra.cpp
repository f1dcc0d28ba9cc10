// A surface straight from a volume:
//
//     volume        -> planes of a slab   query/slabs/slab_reader.h
//     planes        -> surface in a slab  query/slabs/march_slab.h
//     all the slabs -> one mesh           query/slabs/join_slabs.h
//     the mesh      -> without faults     query/slabs/settle_mesh.h
#include <fmt/format.h>
#include <oneapi/tbb/parallel_pipeline.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>

#include <isonest/march.h>

#include "query/apart/keep_apart.h"
#include "query/mesh/coordinate_rounding.h"
#include "query/slabs/join_slabs.h"
#include "query/slabs/march_slab.h"
#include "query/slabs/node_bits.h"
#include "query/slabs/settle_mesh.h"
#include "query/slabs/slab_reader.h"
#include "store/base/memory_budget.h"
#include "store/base/workers.h"
#include "store/container/extent.h"

namespace isonest {
using namespace detail;
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr std::int64_t kMostLayers = 16;  ///< of a slab
/// Vertices of a slab have three quarters of the 32-bit numbers at most.
constexpr std::int64_t kMostNodes = std::int64_t{1} << 29U;

struct Range {
    double low = kInfinity;
    double high = -kInfinity;
    void add(const Range& other) {
        low = std::min(low, other.low);
        high = std::max(high, other.high);
    }
};

template <class T>
Range range_of(const SlabValues<T>& values, std::int64_t begin, std::int64_t end) {
    Range range;
    for (std::int64_t z = begin; z < end; ++z) {
        widen_range(values.at({0, 0, z}), values.nodes.x * values.nodes.y, range.low, range.high);
    }
    return range;
}

/// Empty if the volume can be marched, else why not.
std::string why_not_marched(const VolumeDescription& volume) {
    if (volume.labels) {
        return "its values are labels of 64 bits, of which a store knows the surfaces";
    }
    if (volume.direction != kAlongWorld) {
        return "its axes are not along the world's, which is for a store";
    }
    return "";
}

/// Throws Error{invalid_argument, unsupported, limit}.
void require_marchable(const VolumeDescription& volume, double iso) {
    const Int3& n = volume.nodes;
    if (!std::isfinite(iso)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("isovalue {}: must be a finite number", iso));
    }
    if (const std::string why = why_no_place(n, volume.spacing, volume.origin); !why.empty()) {
        throw Error(ErrorKind::invalid_argument, {volume.name}, why,
                    {{RemedyKind::place_in_world, "spacing,origin"}});
    }
    if (std::min({n.x, n.y, n.z}) < 2) {
        throw Error(ErrorKind::invalid_argument, {volume.name},
                    fmt::format("{} x {} x {} nodes have no cells", n.x, n.y, n.z));
    }
    if (const std::string why = why_not_marched(volume); !why.empty()) {
        throw Error(ErrorKind::unsupported, {volume.name}, why);
    }
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        const double last = volume.origin[a] + volume.spacing[a] * static_cast<double>(n[axis] - 1);
        const double most = std::max(std::fabs(volume.origin[a]), std::fabs(last));
        if (!(most <= static_cast<double>(std::numeric_limits<float>::max()))) {
            throw Error(ErrorKind::limit, {volume.name},
                        fmt::format("the volume reaches {} = {:.6g}, and a mesh's 32-bit floats "
                                    "end before",
                                    "xyz"[a], most),
                        {{RemedyKind::place_in_world, "spacing,origin"}});
        }
    }
    if (n.x * n.y > kMostNodes / 2) {
        throw Error(ErrorKind::limit, {volume.name},
                    "a layer of cells can have more vertices than 32 bits can number");
    }
}

/// How the layers of a volume are shared out.
struct SlabPlan {
    std::int64_t layers = 1;  ///< of a slab
    int slabs_at_once = 1;
    int threads = 1;
};

/// What slabs of so many layers need.
struct SlabNeeds {
    std::uint64_t all;   ///< bytes in any case
    std::uint64_t each;  ///< bytes of one that is worked on
};
SlabNeeds needs_of(const SlabReader& reader, const Int3& nodes, std::int64_t layers) {
    return {kLibraryHeap + reader.own_bytes(layers),
            reader.slab_bytes(layers) + march_slab_bytes(nodes)};
}

/// Throws Error{limit}.
SlabPlan plan_of(const SlabReader& reader, const VolumeDescription& volume,
                 const ExtractOptions& options) {
    const Int3& n = volume.nodes;
    const SlabNeeds least = needs_of(reader, n, 1);
    require_memory(volume.name, options.memory, least.all + least.each, "planes of this volume");
    SlabPlan plan;
    plan.threads = Workers::count_of(options.threads);
    const auto fits = [&](std::int64_t layers, int slabs) {
        const SlabNeeds needs = needs_of(reader, n, layers);
        return needs.all + static_cast<std::uint64_t>(slabs) * needs.each <= options.memory;
    };
    // Several slabs for each thread, so that all have work until the end.
    plan.layers = std::clamp<std::int64_t>((n.z - 1) / (4 * plan.threads), 2, kMostLayers);
    plan.layers = std::clamp<std::int64_t>(kMostNodes / (n.x * n.y), 1, plan.layers);
    while (plan.layers > 1 && !fits(plan.layers, plan.threads)) {
        plan.layers /= 2;
    }
    while (plan.threads > 1 && !fits(plan.layers, plan.threads)) {
        --plan.threads;
    }
    plan.slabs_at_once = fits(plan.layers, plan.threads + 1) ? plan.threads + 1 : plan.threads;
    return plan;
}

/// Reads slabs in order, calls compute(layers, planes) for each in parallel and use(result) in
/// order.
template <class Result, class Compute, class Use>
void each_slab(SlabReader& reader, std::int64_t layers, const SlabPlan& plan, Progress& progress,
               const Compute& compute, const Use& use) {
    struct Task {
        Slab layers;
        SlabPlanes planes;
        Result result;
    };
    progress.begin("march", static_cast<std::uint64_t>(layers), "layers");
    std::int64_t next = 0;
    using Token = std::shared_ptr<Task>;
    const auto read = tbb::make_filter<void, Token>(
        tbb::filter_mode::serial_in_order, [&](tbb::flow_control& control) -> Token {
            if (next == layers) {
                control.stop();
                return nullptr;
            }
            progress.check();
            const Slab slab{next, std::min(next + plan.layers, layers)};
            next = slab.end;
            return std::make_shared<Task>(Task{slab, reader.read(slab), {}});
        });
    const auto work = tbb::make_filter<Token, Token>(tbb::filter_mode::parallel, [&](Token task) {
        task->result = compute(task->layers, task->planes);
        task->planes = {};
        return task;
    });
    const auto hand_over =
        tbb::make_filter<Token, void>(tbb::filter_mode::serial_in_order, [&](const Token& task) {
            use(std::move(task->result));
            progress.advance(static_cast<std::uint64_t>(task->layers.end - task->layers.begin));
        });
    tbb::parallel_pipeline(static_cast<std::size_t>(plan.slabs_at_once), read & work & hand_over);
}

/// A slab's surface, and the range of its values.
struct SlabResult {
    MarchedSlab slab;
    Range range;
};

template <class T>
SlabResult marched(const SlabPlanes& planes, const Int3& nodes, const Slab& layers,
                   const SlabPlace& place, const SlabEstimate& likely) {
    const SlabValues<T> values{reinterpret_cast<const T*>(planes.data), planes.first, nodes};
    const std::int64_t end = layers.end + 1 == nodes.z ? nodes.z : layers.end;
    SlabResult result;
    result.range = range_of(values, layers.begin, end);
    if (NodeBits<T>::crosses(place.iso)) {
        result.slab = march_slab(values, layers, place, likely);
    }
    return result;
}

MeshLayout layout_of(const VolumeDescription& volume, bool normals) {
    MeshLayout layout;
    layout.unit = volume.unit;
    if (normals) {
        layout.attributes.push_back({"normal", 3, false, 0});
        layout.row_bytes = layout.attributes.back().bytes();
    }
    return layout;
}

}  // namespace

ExtractReport march_hexahedra(VolumeSource& volume, const MarchQuery& query,
                              const MakeRoom& make_room, const ExtractOptions& options,
                              Progress& progress) {
    const auto start = std::chrono::steady_clock::now();
    const VolumeDescription description = volume.describe();
    const Int3& nodes = description.nodes;
    require_marchable(description, query.iso);
    SlabReader reader(volume);
    const SlabPlan plan = plan_of(reader, description, options);
    MeshLayout layout = layout_of(description, query.normals);
    ExtractReport report;
    report.coordinate_rounding =
        coordinate_rounding(nodes, description.spacing, description.origin);
    const SlabPlace place{query.iso, query.normals, description.spacing, description.origin,
                          sight_apart(report.coordinate_rounding, kLeastApart)};
    Workers(plan.threads).execute([&] {
        SlabJoin join;
        Range range;
        // Of the slab that came last. What is made does not depend on it.
        std::atomic<std::size_t> last_vertices{0};
        std::atomic<std::size_t> last_triangles{0};
        each_slab<SlabResult>(
            reader, nodes.z - 1, plan, progress,
            [&](const Slab& layers, const SlabPlanes& planes) {
                const SlabEstimate likely{last_vertices * 9 / 8, last_triangles * 9 / 8};
                return dispatch(description.type, [&](auto tag) {
                    return marched<typename decltype(tag)::type>(planes, nodes, layers, place,
                                                                 likely);
                });
            },
            [&](SlabResult&& result) {
                range.add(result.range);
                last_vertices = result.slab.positions.size();
                last_triangles = result.slab.triangles.size();
                join.append(std::move(result.slab));
            });
        report.value_range = std::max(range.high - range.low, 0.0);
        const JoinedMesh joined = join.finish(layout, make_room, options.quality, progress);
        report.traversal.visited = joined.cells;
        report.traversal.leaves = joined.cells;
        report.vertices = layout.vertices;
        report.triangles = layout.elements;
        report.mending.zero_area = joined.zero_area_triangles;
        report.measures = joined.sums.measures();
        if (joined.angles) {
            report.quality = joined.angles->quality();
        }
        settle_mesh(joined, layout, make_room, description, options, report, progress);
    });
    report.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return report;
}

ExtractReport march_hexahedra(VolumeSource& volume, const MarchQuery& query, MeshCollector& mesh,
                              const ExtractOptions& options, Progress& progress) {
    return march_hexahedra(
        volume, query,
        [&](const MeshLayout& layout) {
            mesh.begin(layout);
            return MeshRoom{mesh.vertices, mesh.triangles, mesh.normals};
        },
        options, progress);
}

std::optional<std::uint64_t> march_memory(VolumeSource& volume) {
    const VolumeDescription description = volume.describe();
    const Int3& n = description.nodes;
    if (!why_not_marched(description).empty() || std::min({n.x, n.y, n.z}) < 2 ||
        n.x * n.y > kMostNodes / 2) {
        return std::nullopt;
    }
    const SlabNeeds needs = needs_of(SlabReader(volume), n, 1);
    return needs.all + needs.each;
}

std::optional<std::pair<double, double>> finite_range(VolumeSource& volume,
                                                      const ExtractOptions& options,
                                                      Progress& progress) {
    const VolumeDescription description = volume.describe();
    const Int3& nodes = description.nodes;
    SlabReader reader(volume);
    const SlabPlan plan = plan_of(reader, description, options);
    Range range;
    Workers(plan.threads).execute([&] {
        // A layer for each plane: the last one has no cells.
        each_slab<Range>(
            reader, nodes.z, plan, progress,
            [&](const Slab& layers, const SlabPlanes& planes) {
                return dispatch(description.type, [&](auto tag) {
                    using T = typename decltype(tag)::type;
                    return range_of(
                        SlabValues<T>{reinterpret_cast<const T*>(planes.data), planes.first, nodes},
                        layers.begin, layers.end);
                });
            },
            [&](const Range& found) { range.add(found); });
    });
    if (!(range.low <= range.high)) {
        return std::nullopt;
    }
    return std::pair{range.low, range.high};
}

}  // namespace isonest
