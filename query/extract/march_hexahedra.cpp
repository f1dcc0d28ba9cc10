// A surface straight from a volume:
//
//     volume        -> planes of a slab   query/slabs/slab_reader.h
//     planes        -> surface in a slab  query/slabs/march_slab.h
//     all the slabs -> one mesh           query/slabs/join_slabs.h
//
// Where float32 has left triangles without area, the mesh is mended as the stage of that name does.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <filesystem>

#include <isonest/error.h>
#include <isonest/march.h>

#include "query/mesh/coordinate_rounding.h"
#include "query/mesh/mend_triangles.h"
#include "query/mesh/scratch_mesh.h"
#include "query/slabs/each_slab.h"
#include "query/slabs/join_slabs.h"
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
    if (normals) {
        layout.attributes.push_back({"normal", 3, false, 0});
        layout.row_bytes = layout.attributes.back().bytes();
    }
    return layout;
}

/// Hands a mesh in memory to a sink.
void hand_over(const MeshRoom& mesh, const MeshLayout& layout, MeshSink& sink) {
    sink.begin(layout);
    const auto rows = std::as_bytes(mesh.normals);
    for (std::size_t at = 0; at < mesh.vertices.size(); at += MeshSink::kMostRows) {
        const std::size_t count = std::min(MeshSink::kMostRows, mesh.vertices.size() - at);
        sink.add_vertices({at, mesh.vertices.subspan(at, count),
                           rows.subspan(at * layout.row_bytes, count * layout.row_bytes),
                           layout.row_bytes});
    }
    std::vector<std::array<std::uint64_t, 3>> corners;
    for (std::size_t at = 0; at < mesh.triangles.size(); at += MeshSink::kMostRows) {
        const std::size_t count = std::min(MeshSink::kMostRows, mesh.triangles.size() - at);
        const auto some = mesh.triangles.subspan(at, count);
        corners.clear();
        for (const auto& t : some) {
            corners.push_back({t[0], t[1], t[2]});
        }
        sink.add_elements({at, corners, some, {0, mesh.vertices, rows, layout.row_bytes}});
    }
    sink.end();
}

/// Puts a mesh into the room that is made for it.
class RoomSink : public MeshSink {
  public:
    explicit RoomSink(const MakeRoom& make_room) : make_room_(make_room) {}

    void begin(const MeshLayout& layout) override { room_ = make_room_(layout); }
    void add_vertices(const VertexBatch& batch) override {
        std::copy(batch.positions.begin(), batch.positions.end(),
                  room_.vertices.subspan(batch.first).begin());
        if (!room_.normals.empty()) {
            std::memcpy(room_.normals.subspan(batch.first).data(), batch.attributes.data(),
                        batch.attributes.size());
        }
    }
    void add_elements(const ElementBatch& batch) override {
        std::transform(batch.corners.begin(), batch.corners.end(),
                       room_.triangles.subspan(batch.first).begin(), [](const auto& c) {
                           return std::array{static_cast<std::uint32_t>(c[0]),
                                             static_cast<std::uint32_t>(c[1]),
                                             static_cast<std::uint32_t>(c[2])};
                       });
    }

  private:
    const MakeRoom& make_room_;
    MeshRoom room_;
};

/// Mends what has no area, as MendStage does, in another room.
void mend(const MeshRoom& mesh, const MeshLayout& layout, const MakeRoom& make_room,
          const VolumeDescription& volume, const ExtractOptions& options, ExtractReport& report,
          Progress& progress) {
    const std::filesystem::path folder =
        options.scratch.empty() ? std::filesystem::temp_directory_path() : options.scratch;
    ScratchMesh whole(folder);
    hand_over(mesh, layout, whole);
    Double3 least_step{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        least_step[axis] = volume.spacing[axis] * kLeastNudge;
    }
    const MendedTriangles mended = mend_triangles(whole, least_step, folder, progress);
    report.scratch_bytes = whole.bytes() + mended.scratch_bytes;
    report.mending.mended = mended.found - mended.left;
    double moved = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        moved = std::max(moved, mended.moved[axis] / volume.spacing[axis]);
    }
    report.coordinate_rounding += moved;
    RoomSink into(make_room);
    MeasuringSink measuring(into, options.quality);
    const EmittedMesh emitted = emit_elements(whole, whole.corners(), folder, measuring, progress);
    measuring.report(report);
    report.vertices = emitted.vertices;
    report.triangles = emitted.elements;
    report.mending.zero_area = emitted.zero_area_triangles;
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
    const SlabPlace place{query.iso, query.normals, description.spacing, description.origin};

    ExtractReport report;
    report.coordinate_rounding =
        coordinate_rounding(nodes, description.spacing, description.origin);
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
        if (report.mending.zero_area > 0) {
            mend(joined.room, layout, make_room, description, options, report, progress);
        }
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
