#include "query/slabs/settle_mesh.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <mutex>
#include <numeric>
#include <vector>

#include "query/apart/complete_normals.h"
#include "query/apart/placed_vertices.h"
#include "query/apart/touched_triangles.h"
#include "query/mesh/coordinate_rounding.h"
#include "query/mesh/measuring_sink.h"
#include "query/mesh/mend_triangles.h"
#include "query/mesh/surface_sums.h"
#include "query/mesh/zero_area.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kAtOnce = std::size_t{1} << 16U;

/// Calls work(first, count) for pieces of `size` rows, from all threads of the arena.
template <class Work>
void each_piece(std::size_t size, const Work& work) {
    tbb::parallel_for(std::size_t{0}, (size + kAtOnce - 1) / kAtOnce, [&](std::size_t piece) {
        work(piece * kAtOnce, std::min(kAtOnce, size - piece * kAtOnce));
    });
}

/// The smallest box that holds the vertices.
void find_box(std::span<const std::array<float, 3>> vertices, MeshLayout& layout) {
    layout.lo = MeshLayout::kEmptyLo;
    layout.hi = MeshLayout::kEmptyHi;
    std::mutex mutex;
    each_piece(vertices.size(), [&](std::size_t first, std::size_t count) {
        std::array<float, 3> lo = MeshLayout::kEmptyLo;
        std::array<float, 3> hi = MeshLayout::kEmptyHi;
        for (const auto& p : vertices.subspan(first, count)) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                lo[axis] = std::min(lo[axis], p[axis] + 0.0F);  // no negative zero
                hi[axis] = std::max(hi[axis], p[axis] + 0.0F);
            }
        }
        const std::lock_guard lock(mutex);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            layout.lo[axis] = std::min(layout.lo[axis], lo[axis]);
            layout.hi[axis] = std::max(layout.hi[axis], hi[axis]);
        }
    });
}

/// The triangles that are left of a mesh, in another room; vertices in the order in which these
/// first name them.
class Renumbered {
  public:
    /// Those with kNoTriangle for a corner go. `old` is of no use afterwards.
    Renumbered(const MeshRoom& old, MeshLayout layout, const MakeRoom& make_room,
               const ScratchFolder& folder, Progress& progress)
        : number_file_(folder) {
        number_file_.map(old.vertices.size() * sizeof(std::uint32_t));
        const auto number = number_file_.as<std::uint32_t>();
        std::uint32_t vertices = 0;
        std::uint64_t triangles = 0;
        for (std::size_t i = 0; i < old.triangles.size(); ++i) {
            if (i % kAtOnce == 0) {
                progress.check();
            }
            const auto t = old.triangles[i];
            if (t[0] == kNoTriangle) {
                continue;
            }
            old.triangles[triangles++] = t;
            for (const std::uint32_t v : t) {
                if (number[v] == 0) {
                    number[v] = ++vertices;
                }
            }
        }
        layout.vertices = vertices;
        layout.elements = triangles;
        // The second room may take the place of the first.
        using Row = std::array<float, 3>;
        using Triangle = std::array<std::uint32_t, 3>;
        ScratchFile positions(folder);
        ScratchFile normals(folder);
        ScratchFile corners(folder);
        positions.map(layout.vertices * sizeof(Row));
        normals.map(old.normals.empty() ? 0 : layout.vertices * sizeof(Row));
        corners.map(layout.elements * sizeof(Triangle));
        each_piece(old.vertices.size(), [&](std::size_t first, std::size_t count) {
            for (std::size_t v = first; v < first + count; ++v) {
                if (number[v] != 0) {
                    positions.as<Row>()[number[v] - 1] = old.vertices[v];
                    if (!old.normals.empty()) {
                        normals.as<Row>()[number[v] - 1] = old.normals[v];
                    }
                }
            }
        });
        each_piece(triangles, [&](std::size_t first, std::size_t count) {
            for (std::size_t i = first; i < first + count; ++i) {
                const Triangle& t = old.triangles[i];
                corners.as<Triangle>()[i] = {number[t[0]] - 1, number[t[1]] - 1, number[t[2]] - 1};
            }
        });
        find_box(positions.as<Row>().first(vertices), layout);
        room_ = make_room(layout);
        const auto copy = [](const auto& from, const auto& to) {
            each_piece(to.size(), [&](std::size_t first, std::size_t count) {
                std::copy_n(from.begin() + static_cast<std::ptrdiff_t>(first), count,
                            to.begin() + static_cast<std::ptrdiff_t>(first));
            });
        };
        copy(positions.as<Row>(), room_.vertices);
        copy(normals.as<Row>(), room_.normals);
        copy(corners.as<Triangle>(), room_.triangles);
    }

    [[nodiscard]] const MeshRoom& room() const { return room_; }
    /// Replaces numbers of vertices before by those now; vertices that went are left out.
    void renumber(std::vector<std::uint32_t>& vertices) const {
        const auto number = number_file_.as<std::uint32_t>();
        std::erase_if(vertices, [&](std::uint32_t v) { return number[v] == 0; });
        for (std::uint32_t& v : vertices) {
            v = number[v] - 1;
        }
    }

  private:
    ScratchFile number_file_;  ///< by the number before; from 1 on
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
    report.apart = {apart.moved, apart.left};
    report.coordinate_rounding += most_in_lattice(apart.by, volume.spacing);
}

/// Of a mesh whose vertices have moved, or others. Returns its triangles without area.
std::uint64_t measure(const MeshRoom& mesh, const MeshLayout& layout, bool with_quality,
                      ExtractReport& report) {
    const SurfaceSums none(layout);
    SurfaceSums sums = none;
    AngleCounts angles;
    std::uint64_t zero_area = 0;
    std::mutex mutex;
    each_piece(mesh.triangles.size(), [&](std::size_t first, std::size_t count) {
        const auto some = mesh.triangles.subspan(first, count);
        std::vector<std::array<std::uint64_t, 3>> corners;
        corners.reserve(some.size());
        AngleCounts own;
        std::uint64_t own_zero_area = 0;
        for (const auto& t : some) {
            const auto& at = mesh.vertices;
            corners.push_back({t[0], t[1], t[2]});
            own_zero_area += has_no_area(at[t[0]], at[t[1]], at[t[2]]) ? 1 : 0;
            if (with_quality) {
                own.add(smallest_angle(at[t[0]], at[t[1]], at[t[2]]));
            }
        }
        SurfaceSums own_sums = none;
        own_sums.add({first, corners, some, {0, mesh.vertices}});
        const std::lock_guard lock(mutex);
        sums.add(own_sums);
        angles.add(own);
        zero_area += own_zero_area;
    });
    report.measures = sums.measures();
    if (with_quality) {
        report.quality = angles.quality();
    }
    return zero_area;
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

/// Whether one of `moved` has come into the place of another vertex.
bool share_places(const MeshRoom& mesh, std::span<const std::uint32_t> moved) {
    std::vector<std::array<float, 3>> places;
    for (const std::uint32_t v : moved) {
        places.push_back(mesh.vertices[v]);
    }
    std::sort(places.begin(), places.end());
    if (std::adjacent_find(places.begin(), places.end()) != places.end()) {
        return true;
    }
    std::atomic<std::uint64_t> count = 0;
    each_piece(places.empty() ? 0 : mesh.vertices.size(), [&](std::size_t first,
                                                              std::size_t in_piece) {
        const auto some = mesh.vertices.subspan(first, in_piece);
        count +=
            static_cast<std::uint64_t>(std::count_if(some.begin(), some.end(), [&](const auto& p) {
                return std::binary_search(places.begin(), places.end(), p);
            }));
    });
    return count > moved.size();
}

/// All vertices of a mesh, with places that several of them may have. Throws Error{io}.
PlacedVertices all_placed(const MeshRoom& mesh, const ScratchFolder& folder) {
    ScratchFile numbers(folder);
    numbers.map(mesh.vertices.size() * sizeof(std::uint32_t));
    const auto all = numbers.as<std::uint32_t>().first(mesh.vertices.size());
    std::iota(all.begin(), all.end(), 0U);
    return {mesh.vertices, all, folder};
}

/// Returns the room that holds the mended mesh.
MeshRoom mend(const JoinedMesh& joined, MeshLayout layout, const MakeRoom& make_room,
              const VolumeDescription& volume, const ScratchFolder& folder, bool with_quality,
              ExtractReport& report, Progress& progress) {
    Double3 least_step{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        least_step[axis] = volume.spacing[axis] * kLeastNudge;
    }
    std::vector<std::uint32_t> moved;
    const MendedTriangles mended =
        mend_triangles(joined.room.vertices, joined.room.triangles, layout.lo, layout.hi,
                       least_step, moved, folder, progress);
    report.mending.mended = mended.found - mended.left;
    report.coordinate_rounding += most_in_lattice(mended.moved, volume.spacing);
    const Renumbered renumbered(joined.room, layout, make_room, folder, progress);
    const MeshRoom& mesh = renumbered.room();
    renumbered.renumber(moved);
    std::vector<std::uint32_t> not_alone = joined.not_alone;
    renumbered.renumber(not_alone);
    if (!are_all_alone(mesh, not_alone) || share_places(mesh, moved)) {
        const PlacedVertices vertices = all_placed(mesh, folder);
        sort_by_place(vertices.all());
        move_apart(
            mesh.vertices, mesh.triangles.size(),
            [&](std::uint64_t t) {
                const auto& c = mesh.triangles[t];
                return ElementCorners{c[0], c[1], c[2]};
            },
            vertices, layout, volume, folder, report, progress);
    }
    report.vertices = mesh.vertices.size();
    report.triangles = mesh.triangles.size();
    find_box(mesh.vertices, layout);
    report.mending.zero_area = measure(mesh, layout, with_quality, report);
    return mesh;
}

MeshRoom settled_room(const JoinedMesh& joined, const MeshLayout& layout, const MakeRoom& make_room,
                      const VolumeDescription& volume, const ScratchFolder& folder,
                      const ExtractOptions& options, ExtractReport& report, Progress& progress) {
    const MeshRoom& mesh = joined.room;
    if (joined.zero_area_triangles > 0) {
        return mend(joined, layout, make_room, volume, folder, options.quality, report, progress);
    }
    if (are_all_alone(mesh, joined.not_alone)) {
        return mesh;  // without a temporary file
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
    return mesh;
}

}  // namespace

void settle_mesh(const JoinedMesh& joined, const MeshLayout& layout, const MakeRoom& make_room,
                 const VolumeDescription& volume, const ExtractOptions& options,
                 ExtractReport& report, Progress& progress) {
    const ScratchFolder folder = ScratchFolder::metered(options.scratch);
    const MeshRoom room =
        settled_room(joined, layout, make_room, volume, folder, options, report, progress);
    complete_normals(room.vertices, room.triangles, room.normals, folder, progress);
    report.scratch_bytes = folder.meter()->peak();
}

}  // namespace isonest::detail
