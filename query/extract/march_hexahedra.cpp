// A surface straight from a volume:
//
//     volume        -> planes of a slab   query/slabs/slab_reader.h
//     planes        -> surface in a slab  query/slabs/march_slab.h
//     all the slabs -> one mesh           query/slabs/join_slabs.h
//     the mesh      -> without faults     query/slabs/settle_mesh.h
#include <algorithm>
#include <atomic>
#include <chrono>

#include <isonest/error.h>
#include <isonest/march.h>

#include "query/apart/keep_apart.h"
#include "query/mesh/coordinate_rounding.h"
#include "query/slabs/each_slab.h"
#include "query/slabs/join_slabs.h"
#include "query/slabs/settle_mesh.h"
#include "query/slabs/value_range.h"
#include "store/base/workers.h"

namespace isonest {
using namespace detail;
namespace {

/// A slab's surface, and the range of its values.
struct SlabResult {
    MarchedSlab slab;
    ValueRange range;
};

/// Throws Error{unsupported} too.
void require_along_world(const VolumeDescription& volume) {
    if (volume.direction != kAlongWorld) {
        throw Error(ErrorKind::unsupported, {volume.name},
                    "its axes are not along the world's, which is for a store");
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
    const SlabPlan plan = slab_plan(reader, description, options);
    MeshLayout layout = layout_of(description, query.normals);
    ExtractReport report;
    report.coordinate_rounding =
        coordinate_rounding(nodes, description.spacing, description.origin);
    const SlabPlace place{query.iso, query.normals, description.spacing, description.origin,
                          sight_apart(report.coordinate_rounding, kLeastApart)};
    Workers(plan.threads).execute([&] {
        SlabJoin join;
        ValueRange range;
        SlabMarchers marchers(description.type, nodes, place);
        // Of the slab that came last. What is made does not depend on it.
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
        report.value_range = std::max(range.high - range.low, 0.0);
        const JoinedMesh joined = join.finish(layout, make_room, options.quality, progress);
        report.traversal.cells = Cells::hexahedra;
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
    if (!is_marchable(description) || description.direction != kAlongWorld) {
        return std::nullopt;
    }
    return least_slab_memory(SlabReader(volume), description);
}

std::optional<std::pair<double, double>> finite_range(VolumeSource& volume,
                                                      const ExtractOptions& options,
                                                      Progress& progress) {
    const VolumeDescription description = volume.describe();
    const Int3& nodes = description.nodes;
    SlabReader reader(volume);
    const SlabPlan plan = slab_plan(reader, description, options);
    ValueRange range;
    Workers(plan.threads).execute([&] {
        // A layer for each plane: the last one has no cells.
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
