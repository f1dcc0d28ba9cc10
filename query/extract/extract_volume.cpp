// Extracts a surface at full resolution directly from a volume into a sink:
//
//     volume -> planes of a slab   query/slabs/slab_reader.h
//     planes -> parts              plain surface: query/slabs/march_slab.h, join_slabs.h;
//                                  otherwise the same parts as from a store:
//                                  query/slabs/volume_chunks.h,
//                                  query/traverse/bricks/traverse_finest.h
//     parts  -> mesh in the sink   query/extract/extraction.h
//
// Only files grow with the volume or the mesh.

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <memory>
#include <optional>

#include <isonest/error.h>
#include <isonest/march.h>

#include "query/apart/keep_apart.h"
#include "query/apart/manifold.h"
#include "query/extract/combinations.h"
#include "query/extract/extract_query.h"
#include "query/extract/extraction.h"
#include "query/extract/report.h"
#include "query/mesh/mend_triangles.h"
#include "query/mesh/vertex_stars.h"
#include "query/slabs/join_slabs.h"
#include "query/slabs/march_slab.h"
#include "query/slabs/slab_reader.h"
#include "query/slabs/volume_chunks.h"
#include "query/traverse/bricks/traverse_finest.h"
#include "query/values/node_sampler.h"
#include "store/base/memory.h"
#include "store/base/workers.h"
#include "store/container/format.h"
#include "store/files/scratch_file.h"

namespace isonest {
namespace detail {
namespace {

/// Weights of parts.
constexpr std::size_t kMinMarched = 4096;
constexpr std::size_t kMaxMarched = 65536;

/// Distribution of the memory of a volume that is marched into parts.
struct MarchBudget {
    SlabPlan plan;
    std::size_t part = kMinMarched;  ///< weight at which parts end
    std::uint64_t parts = 0;         ///< bytes for finished parts
};

/// Minimum size of a slab's concurrent parts, bytes: they end with a row of cells.
std::uint64_t min_parts(const Int3& nodes) {
    return (kMinMarched + 2 * static_cast<std::uint64_t>(nodes.x)) * kBytesPerPartWeight;
}

MarchBudget march_budget(const SlabReader& reader, const VolumeDescription& volume,
                         const MemoryShare& memory) {
    MarchBudget budget{slab_plan(reader, volume, memory, min_parts(volume.nodes))};
    const auto slabs = static_cast<std::uint64_t>(budget.plan.slabs_at_once);
    std::uint64_t spare = budget.plan.spare;
    budget.part = std::clamp<std::size_t>(kMinMarched + spare / 4 / slabs / kBytesPerPartWeight,
                                          kMinMarched, kMaxMarched);
    spare -= slabs * (budget.part - kMinMarched) * kBytesPerPartWeight;
    budget.parts = spare / 2;
    return budget;
}

/// Fills the parts and seals them.
TraversalResult march_into(PartStore& parts, SlabReader& reader, const VolumeDescription& volume,
                           const SlabPlace& place, const MarchBudget& budget, Progress& progress) {
    /// The result of a slab.
    struct Found {
        ValueRange range;
        std::uint64_t cells = 0;
    };
    const Int3& nodes = volume.nodes;
    SlabMarchers marchers(volume.type, nodes, place);
    ValueRange range;
    TraversalResult result;
    each_slab<Found>(
        reader, nodes.z - 1, budget.plan, "extract", progress,
        [&](const Slab& layers, const SlabPlanes& planes) {
            Found here;
            here.range = range_of(volume.type, planes, nodes, layers.begin,
                                  layers.end + 1 == nodes.z ? nodes.z : layers.end);
            marchers.with_one([&](SlabMarcher& marcher) {
                marcher.march_parts(planes, layers, budget.part,
                                    [&](std::uint64_t order, MarchedSlab&& slab) {
                                        here.cells += slab.cells;
                                        parts.append(order, part_of(std::move(slab)));
                                    });
            });
            return here;
        },
        [&](const Found& here) {
            range.add(here.range);
            result.counts.leaves += here.cells;
        });
    parts.seal();
    result.counts.visited = result.counts.leaves;
    result.value_range = std::max(range.high - range.low, 0.0);
    return result;
}

/// Distribution of the memory of a volume if its parts are those of its store.
struct LayerBudget {
    StoreLayout layout;
    SlabPlan plan;
    std::size_t part_vertices = kMinMarched;
    std::uint64_t cache = 0;  ///< bytes of each layer's cache
    std::uint64_t parts = 0;  ///< bytes for finished parts
};

/// Nodes per axis of a chunk: as many as the memory allows, because small chunks have more
/// neighbours.
constexpr std::array kChunks{32, 16, 8};

/// Memory for chunks of a size.
struct LayerNeeds {
    StoreLayout layout;
    std::uint64_t chunks;  ///< held by a thread
    std::uint64_t thread;
    std::uint64_t slab;
    std::uint64_t fixed;  ///< of the reader

    /// All that is needed at least.
    [[nodiscard]] std::uint64_t all() const { return fixed + slab + thread; }
};

/// The bricks of the volume's store, a layer of chunks at a time.
class VolumeLayers {
  public:
    /// All must outlive it.
    VolumeLayers(SlabReader& reader, const VolumeDescription& volume, const TraversalQuery& query)
        : reader_(reader), volume_(volume), query_(query) {}

    [[nodiscard]] LayerNeeds needs(int chunk) const {
        LayerNeeds needs{StoreLayout(chunked_header_of(volume_, chunk)), 0, 0, 0, 0};
        needs.chunks = TraversalHeap(needs.layout, query_).chunks();
        needs.thread = needs.chunks + table_heap(needs.layout) + list_heap(needs.layout) +
                       2 * kMinMarched * LocalMesh::kBytesPerVertex;
        needs.slab = reader_.slab_bytes(chunk) + VolumeChunks::heap(needs.layout);
        needs.fixed = reader_.own_bytes(chunk);
        return needs;
    }
    [[nodiscard]] LayerBudget budget(const MemoryShare& memory) const;
    /// Fills the parts with those of the volume's store, and seals them.
    TraversalResult traverse_into(PartStore& parts, const LayerBudget& budget, Progress& progress);

  private:
    SlabReader& reader_;
    const VolumeDescription& volume_;
    const TraversalQuery& query_;
};

LayerBudget VolumeLayers::budget(const MemoryShare& memory) const {
    LayerBudget budget;
    const auto threads = static_cast<std::uint64_t>(memory.threads());
    LayerNeeds least = needs(kChunks.front());
    budget.plan.layers = kChunks.front();
    for (std::size_t i = 1;
         i < kChunks.size() &&
         kLibraryHeap + least.fixed + 2 * least.slab + threads * least.thread > memory.bytes() / 2;
         ++i) {
        least = needs(kChunks[i]);
        budget.plan.layers = kChunks[i];
    }
    memory.require(least.all(), "planes of this volume");
    std::uint64_t left = memory.left() - least.fixed - least.slab;
    if (left >= least.slab + threads * least.thread) {
        budget.plan.slabs_at_once = 2;
        left -= least.slab;
    }
    const std::uint64_t count = std::clamp<std::uint64_t>(left / least.thread, 1, threads);
    left -= count * least.thread;
    budget.layout = std::move(least.layout);
    budget.plan.threads = static_cast<int>(count);
    budget.cache = count * least.chunks + left / 8;
    budget.part_vertices =
        std::clamp<std::size_t>(kMinMarched + left / 4 / count / (2 * LocalMesh::kBytesPerVertex),
                                kMinMarched, kMaxMarched);
    budget.parts = left / 4;
    return budget;
}

TraversalResult VolumeLayers::traverse_into(PartStore& parts, const LayerBudget& budget,
                                            Progress& progress) {
    /// The result of a layer.
    struct Found {
        TraversalCounts counts;
        std::array<double, 2> range;
        bool has_missing = false;
    };
    const PartSink sink = [&parts](std::uint64_t order, const MeshPart& part) {
        parts.append(order, part);
    };
    TraversalResult result;
    ValueRange range;
    each_slab<Found>(
        reader_, volume_.nodes.z - 1, budget.plan, "extract", progress,
        [&](const Slab& layers, const SlabPlanes& planes) {
            const std::int64_t layer = layers.begin / budget.plan.layers;
            const VolumeChunks chunks(budget.layout, planes, layers);
            ChunkCache cache(chunks, budget.cache,
                             query_.attributes.width() > 0 ? NodeSampler::kSides : ChunkSides{});
            TraversalRun run(cache, query_, budget.part_vertices, sink, progress);
            return Found{traverse_finest_layer(run, layer), chunks.range(), chunks.has_missing()};
        },
        [&](const Found& here) {
            result.counts.add(here.counts);
            range.add({here.range[0], here.range[1]});
            result.has_missing = result.has_missing || here.has_missing;
        });
    parts.seal();
    result.value_range = std::max(range.high - range.low, 0.0);
    return result;
}

}  // namespace
}  // namespace detail

ExtractReport extract(VolumeSource& volume, const SurfaceQuery& query, MeshSink& sink,
                      const ExtractOptions& options, Progress& progress) {
    using namespace detail;
    const VolumeDescription description = volume.describe();
    ExtractQuery asked = extract_query(description, query);
    WorldOutput mesh(sink, asked, options, progress);
    const SlabPlace place{query.iso, query.attributes.normals, asked.steps, description.origin,
                          sight_apart(asked.coordinate_rounding, asked.min_apart)};
    Extraction extraction({description.name, header_of(description)}, std::move(asked), mesh.sink(),
                          options, progress);
    extraction.prepare(volume.files());
    SlabReader reader(volume);
    TraversalBudget traversal;
    FoundParts found;
    // The order of a store takes more than a fifth longer (tools/bench/RESULTS.md).
    if (is_plain_surface(query)) {
        const MarchBudget budget = march_budget(reader, description, extraction.memory());
        traversal.threads = budget.plan.threads;
        Workers(budget.plan.threads).execute([&] {
            found.traversal = march_into(*extraction.begin_parts(budget.parts).parts, reader,
                                         description, place, budget, progress);
        });
    } else {
        VolumeLayers layers(reader, description, extraction.asked().traversal);
        const LayerBudget budget = layers.budget(extraction.memory());
        traversal.threads = budget.plan.threads;
        Workers(budget.plan.threads).execute([&] {
            found.traversal =
                layers.traverse_into(*extraction.begin_parts(budget.parts).parts, budget, progress);
        });
    }
    return mesh.report(extraction.finish(found, traversal));
}

std::optional<std::uint64_t> march_memory(VolumeSource& volume, const SurfaceQuery& query) {
    using namespace detail;
    const VolumeDescription description = volume.describe();
    if (!is_marchable(description) ||
        needs_store(description, features_of(query), query.grid.bound.has_value())) {
        return std::nullopt;
    }
    SlabReader reader(volume);
    if (is_plain_surface(query)) {
        return min_slab_memory(reader, description, min_parts(description.nodes));
    }
    const ExtractQuery asked = extract_query(description, query);
    return kLibraryHeap +
           VolumeLayers(reader, description, asked.traversal).needs(kChunks.back()).all();
}

// A surface directly from a volume:
//
//     volume        -> planes of a slab            query/slabs/slab_reader.h
//     planes        -> surface in a slab           query/slabs/march_slab.h
//     all the slabs -> without flat triangles      query/slabs/mend_slabs.h
//                   -> one mesh                    query/slabs/join_slabs.h
//     the mesh      -> vertices separated          query/slabs/join_slabs.h

using namespace detail;
namespace {

/// A slab's surface, and the range of its values.
struct SlabResult {
    MarchedSlab slab;
    ValueRange range;
};

/// Also throws Error{unsupported}.
void require_along_world(const VolumeDescription& volume) {
    if (volume.direction != kAlongWorld) {
        throw Error(ErrorKind::unsupported, {volume.name},
                    "its axes are not along the world's, which needs a store");
    }
}

MeshLayout layout_of(const VolumeDescription& volume, bool normals) {
    MeshLayout layout;
    layout.unit = volume.unit;
    layout.frame = volume.frame;
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
    require_along_world(description);
    SlabReader reader(volume);
    const SlabPlan plan = slab_plan(reader, description, memory_of(options, description.name));
    MeshLayout layout = layout_of(description, query.normals);
    const LatticeSteps steps = header_of(description).steps();
    const double rounding = coordinate_rounding(nodes, steps, description.origin);
    const SlabPlace place{query.iso, query.normals, steps, description.origin,
                          sight_apart(rounding, kMinApart)};
    ExtractReport report;
    Workers(plan.threads).execute([&] {
        SlabJoin join;
        ValueRange range;
        SlabMarchers marchers(description.type, nodes, place);
        // For the last slab. The result does not depend on it.
        std::atomic<std::size_t> last_vertices{0};
        std::atomic<std::size_t> last_triangles{0};
        each_slab<SlabResult>(
            reader, nodes.z - 1, plan, "march", progress,
            [&](const Slab& layers, const SlabPlanes& planes) {
                SlabResult result;
                result.range = range_of(description.type, planes, nodes, layers.begin,
                                        layers.end + 1 == nodes.z ? nodes.z : layers.end);
                marchers.with_one([&](SlabMarcher& marcher) {
                    result.slab = marcher.march(planes, layers,
                                                {last_vertices * 9 / 8, last_triangles * 9 / 8});
                });
                return result;
            },
            [&](SlabResult&& result) {
                range.add(result.range);
                last_vertices = result.slab.positions.size();
                last_triangles = result.slab.triangles.size();
                join.append(std::move(result.slab));
            });
        Double3 min_step = steps.min_along();
        for (double& step : min_step) {
            step *= kMinNudge;
        }
        const ScratchFolder folder = ScratchFolder::metered(options.scratch);
        const JoinedMesh joined =
            join.finish(layout, make_room, min_step, options.quality, folder, progress);
        const SettledMesh settled = settle_mesh(joined, layout, description, folder, progress);
        std::optional<ManifoldReport> manifold;
        if (options.quality) {
            const SharedPlaces found =
                shared_places(layout.vertices, CornerView(joined.room.triangles), folder, progress);
            manifold = {found.edges, found.vertices, 0};
        }
        report = marched(layout, joined, settled, rounding, std::max(range.high - range.low, 0.0),
                         folder.meter()->peak());
        report.manifold = manifold;
    });
    return timed(std::move(report), start);
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
    if (!is_marchable(description) || description.direction != kAlongWorld) {
        return std::nullopt;
    }
    return min_slab_memory(SlabReader(volume), description);
}

std::optional<std::pair<double, double>> finite_range(VolumeSource& volume,
                                                      const ExtractOptions& options,
                                                      Progress& progress) {
    const VolumeDescription description = volume.describe();
    const Int3& nodes = description.nodes;
    SlabReader reader(volume);
    const SlabPlan plan = slab_plan(reader, description, memory_of(options, description.name));
    ValueRange range;
    Workers(plan.threads).execute([&] {
        // One layer for each plane: the last one has no cells.
        each_slab<ValueRange>(
            reader, nodes.z, plan, "march", progress,
            [&](const Slab& layers, const SlabPlanes& planes) {
                return range_of(description.type, planes, nodes, layers.begin, layers.end);
            },
            [&](const ValueRange& found) { range.add(found); });
    });
    if (!(range.low <= range.high)) {
        return std::nullopt;
    }
    return std::pair{range.low, range.high};
}

}  // namespace isonest
