#include "query/slabs/settle_mesh.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <vector>

#include "query/apart/placed_vertices.h"
#include "query/apart/touched_triangles.h"
#include "query/mesh/coordinate_rounding.h"
#include "query/mesh/mend_triangles.h"
#include "query/mesh/scratch_mesh.h"

namespace isonest::detail {
namespace {

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

/// As ApartStage does it. `vertices`: sorted by place; corners(t): of triangle t of `triangles`.
template <class Corners>
void move_apart(std::span<std::array<float, 3>> positions, std::uint64_t triangles,
                const Corners& corners, const PlacedVertices& vertices, const MeshLayout& layout,
                const VolumeDescription& volume, const ScratchFolder& folder, ExtractReport& report,
                Progress& progress) {
    TouchedTriangles touched(vertices.all(), positions.size(), folder);
    touched.gather_among(triangles, corners, progress);
    ApartRange range;
    range.moves = is_short_step(
        step_apart(coordinate_rounding(volume.nodes, volume.spacing, volume.origin), kLeastApart));
    range.lo = layout.lo;
    range.hi = layout.hi;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto last = static_cast<double>(volume.nodes[static_cast<int>(axis)] - 1);
        range.least_step[axis] = volume.spacing[axis] * kLeastApart;
        range.low_faces[axis] = static_cast<float>(volume.origin[axis]);
        range.high_faces[axis] =
            static_cast<float>(volume.origin[axis] + volume.spacing[axis] * last);
    }
    const ApartVertices apart =
        keep_apart(positions, touched.all(), vertices.all(), range, folder, progress);
    report.scratch_bytes = folder.meter()->peak();
    report.apart = {apart.moved, apart.left};
    report.coordinate_rounding += most_in_lattice(apart.by, volume.spacing);
}

void mend(const MeshRoom& mesh, const MeshLayout& layout, const MakeRoom& make_room,
          const VolumeDescription& volume, const ScratchFolder& folder, bool with_quality,
          ExtractReport& report, Progress& progress) {
    ScratchMesh whole(folder);
    hand_over(mesh, layout, whole);
    Double3 least_step{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        least_step[axis] = volume.spacing[axis] * kLeastNudge;
    }
    const MendedTriangles mended = mend_triangles(whole, least_step, folder, progress);
    report.mending.mended = mended.found - mended.left;
    report.coordinate_rounding += most_in_lattice(mended.moved, volume.spacing);
    if (const PlacedVertices vertices(whole, {}, folder); sort_by_place(vertices.all()) > 0) {
        move_apart(
            whole.changeable_positions(), whole.corners().size(),
            [&](std::uint64_t t) { return whole.corners()[t]; }, vertices, whole.layout(), volume,
            folder, report, progress);
    }
    RoomSink into(make_room);
    MeasuringSink measuring(into, with_quality);
    const EmittedMesh emitted = emit_elements(whole, whole.corners(), folder, measuring, progress);
    measuring.report(report);
    report.vertices = emitted.vertices;
    report.triangles = emitted.elements;
    report.mending.zero_area = emitted.zero_area_triangles;
    report.scratch_bytes = folder.meter()->peak();
}

/// Of a mesh whose vertices have moved.
void measure(const MeshRoom& mesh, const MeshLayout& layout, bool with_quality,
             ExtractReport& report) {
    constexpr std::size_t kAtOnce = 1 << 16U;
    const SurfaceSums none(layout);
    SurfaceSums sums = none;
    AngleCounts angles;
    std::mutex mutex;
    const std::size_t pieces = (mesh.triangles.size() + kAtOnce - 1) / kAtOnce;
    tbb::parallel_for(std::size_t{0}, pieces, [&](std::size_t piece) {
        const std::size_t first = piece * kAtOnce;
        const auto some =
            mesh.triangles.subspan(first, std::min(kAtOnce, mesh.triangles.size() - first));
        std::vector<std::array<std::uint64_t, 3>> corners;
        corners.reserve(some.size());
        AngleCounts own;
        for (const auto& t : some) {
            corners.push_back({t[0], t[1], t[2]});
            if (with_quality) {
                own.add(
                    smallest_angle(mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]));
            }
        }
        SurfaceSums own_sums = none;
        own_sums.add({first, corners, some, {0, mesh.vertices}});
        const std::lock_guard lock(mutex);
        sums.add(own_sums);
        angles.add(own);
    });
    report.measures = sums.measures();
    if (with_quality) {
        report.quality = angles.quality();
    }
}

bool are_all_alone(const MeshRoom& mesh, std::span<const std::uint32_t> vertices) {
    std::vector<std::array<float, 3>> places;
    places.reserve(vertices.size());
    for (const std::uint32_t v : vertices) {
        places.push_back(mesh.vertices[v]);
    }
    std::sort(places.begin(), places.end());
    return std::adjacent_find(places.begin(), places.end()) == places.end();
}

}  // namespace

void settle_mesh(const JoinedMesh& joined, const MeshLayout& layout, const MakeRoom& make_room,
                 const VolumeDescription& volume, const ExtractOptions& options,
                 ExtractReport& report, Progress& progress) {
    const ScratchFolder folder = ScratchFolder::metered(options.scratch);
    const MeshRoom& mesh = joined.room;
    if (joined.zero_area_triangles > 0) {
        return mend(mesh, layout, make_room, volume, folder, options.quality, report, progress);
    }
    if (are_all_alone(mesh, joined.not_alone)) {
        return;  // without a temporary file
    }
    const PlacedVertices vertices(mesh.vertices, joined.not_alone, folder);
    sort_by_place(vertices.all());
    move_apart(
        mesh.vertices, mesh.triangles.size(),
        [&](std::uint64_t t) {
            const auto& c = mesh.triangles[t];
            return ElementCorners{c[0], c[1], c[2]};
        },
        vertices, layout, volume, folder, report, progress);
    measure(mesh, layout, options.quality, report);
}

}  // namespace isonest::detail
