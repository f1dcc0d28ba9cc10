#include "query/slabs/join_slabs.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <iterator>
#include <limits>
#include <mutex>
#include <numeric>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/mesh_sink.h>

#include "query/apart/complete_normals.h"
#include "query/apart/keep_apart.h"
#include "query/mesh/measuring_sink.h"
#include "query/mesh/vertex_stars.h"
#include "store/base/box.h"
#include "store/base/vectors.h"

namespace isonest::detail {

MeshPart part_of(MarchedSlab&& slab) {
    const bool normals = !slab.normals.empty();
    MeshPart part;
    std::vector<std::uint32_t> number(slab.positions.size(), MeshPart::kNoVertex);
    part.world.reserve(slab.positions.size());
    part.attributes.reserve(normals ? 3 * slab.positions.size() : 0);
    for (auto& triangle : slab.triangles) {
        for (std::uint32_t& v : triangle) {
            if (number[v] == MeshPart::kNoVertex) {
                number[v] = static_cast<std::uint32_t>(part.world.size());
                part.world.push_back(slab.positions[v]);
                for (std::size_t i = 0; normals && i < 3; ++i) {
                    part.attributes.push_back(std::bit_cast<std::uint32_t>(slab.normals[v][i]));
                }
            }
            v = number[v];
        }
    }
    part.triangles = std::exchange(slab.triangles, {});
    for (const std::uint32_t v : slab.not_alone) {
        if (number[v] != MeshPart::kNoVertex) {
            part.off_edges.push_back(number[v]);
        }
    }
    std::sort(part.off_edges.begin(), part.off_edges.end());

    // Elements with a vertex come first, in ascending order of it; a vertex may have several names.
    std::vector<std::uint32_t> named;
    for (const MarchedSlab::Named& n : slab.shared) {
        named.push_back(n.vertex);
    }
    const auto by_number = [&](std::uint32_t v) { return std::pair(number[v], v); };
    std::sort(named.begin(), named.end(),
              [&](std::uint32_t a, std::uint32_t b) { return by_number(a) < by_number(b); });
    named.erase(std::unique(named.begin(), named.end()), named.end());
    part.shared.reserve(named.size());
    for (const std::uint32_t v : named) {
        part.shared.push_back({number[v]});
    }
    part.names.reserve(slab.shared.size());
    for (const MarchedSlab::Named& n : slab.shared) {
        const auto place = std::lower_bound(
            named.begin(), named.end(), n.vertex,
            [&](std::uint32_t a, std::uint32_t b) { return by_number(a) < by_number(b); });
        part.names.push_back({n.key, static_cast<std::uint32_t>(place - named.begin())});
    }
    return part;
}

namespace {

constexpr std::uint32_t kNoNumber = NumberedSlab::kNoNumber;
constexpr std::uint32_t kForeign = 0xFFFFFFFEU;  ///< among a slab's own numbers

/// A vertex with a name, in one of two slabs: if vertices are the same, the first one is used.
struct Member {
    bool unused;
    bool is_later;
    std::uint32_t vertex;
    auto operator<=>(const Member&) const = default;  // NOLINT(modernize-use-nullptr)
};

}  // namespace

void SlabJoin::append(MarchedSlab&& slab) {
    Part part;
    part.slab = std::move(slab);
    if (!parts_.empty()) {
        weld_edges(parts_.back(), part);
        weld_named(parts_.back(), part);
        parts_.back().slab.on_plane = {};
        parts_.back().slab.named = {};
    }
    parts_.push_back(std::move(part));
}

void SlabJoin::weld_edges(const Part& before, Part& part) {
    const auto& last = before.slab.on_plane[1];
    auto at = last.begin();
    for (const MarchedSlab::OnPlane& v : part.slab.on_plane[0]) {
        at = std::find_if(at, last.end(), [&](const auto& w) { return w.edge >= v.edge; });
        if (at != last.end() && at->edge == v.edge) {
            part.foreign.push_back({v.vertex, at->vertex});
        }
    }
}

/// Vertices with the same name are merged; vertices with two names join both groups.
void SlabJoin::weld_named(Part& before, Part& part) {
    struct Named {
        VertexKey key;
        Member member;
        auto operator<=>(const Named&) const = default;  // NOLINT(modernize-use-nullptr)
    };
    std::vector<Named> names;
    std::vector<Member> members;
    for (const bool is_later : {false, true}) {
        for (const auto& v : is_later ? part.slab.named[0] : before.slab.named[1]) {
            names.push_back({v.key, {!v.used, is_later, v.vertex}});
            members.push_back(names.back().member);
        }
    }
    std::sort(names.begin(), names.end());
    std::sort(members.begin(), members.end());
    members.erase(std::unique(members.begin(), members.end()), members.end());
    const auto place_of = [&](const Member& m) {
        return static_cast<std::uint32_t>(std::lower_bound(members.begin(), members.end(), m) -
                                          members.begin());
    };
    std::vector<std::uint32_t> parent(members.size());
    std::iota(parent.begin(), parent.end(), 0U);
    for (std::size_t i = 1; i < names.size(); ++i) {
        if (names[i].key == names[i - 1].key) {
            unite(std::span(parent), place_of(names[i].member), place_of(names[i - 1].member));
        }
    }
    for (std::uint32_t i = 0; i < members.size(); ++i) {
        const Member& m = members[i];
        const Member& root = members[root_of(std::span(parent), i)];
        if (m.unused || m == root) {
            continue;
        }
        if (m.is_later != root.is_later) {
            part.foreign.push_back({m.vertex, root.vertex});
        } else {
            (m.is_later ? part : before).aliases.push_back({m.vertex, root.vertex});
        }
    }
}

void SlabJoin::number_own(Part& part) {
    auto& triangles = part.slab.triangles;
    if (!part.aliases.empty()) {
        std::vector<std::uint32_t> same(part.slab.positions.size());
        std::iota(same.begin(), same.end(), 0U);
        for (const Alias& alias : part.aliases) {
            same[alias.vertex] = alias.same;
        }
        for (auto& t : triangles) {
            t = {same[t[0]], same[t[1]], same[t[2]]};
        }
    }
    const auto& positions = part.slab.positions;
    part.number.assign(positions.size(), kNoNumber);
    for (const Foreign& f : part.foreign) {
        part.number[f.vertex] = kForeign;
    }
    for (std::size_t i = 0; i < triangles.size(); ++i) {
        const auto& t = triangles[i];
        for (const std::uint32_t v : t) {
            if (part.number[v] == kNoNumber) {
                part.number[v] = part.own++;
            }
        }
        if (has_no_area(positions[t[0]], positions[t[1]], positions[t[2]])) {
            part.flat.push_back(static_cast<std::uint32_t>(i));
        }
    }
}

/// REQUIRES: first_vertex, and the numbers of foreign vertices.
void SlabJoin::number_in_mesh(Part& part) {
    const auto first = static_cast<std::uint32_t>(part.first_vertex);
    for (std::uint32_t& number : part.number) {
        number += number < kForeign ? first : 0;
    }
    for (const Foreign& f : part.foreign) {
        part.number[f.vertex] = f.number;
    }
}

NumberedSlab SlabJoin::numbered(const Part& part) {
    return {part.slab.positions, part.slab.triangles, part.number,
            part.flat,           part.first_vertex,   part.first_triangle};
}

void SlabJoin::find_box(const MeshChanges* changes, MeshLayout& layout) {
    tbb::parallel_for(std::size_t{0}, parts_.size(), [&](std::size_t i) {
        Part& part = parts_[i];
        const auto numbers =
            changes == nullptr ? MeshChanges::Numbers{}
                               : changes->numbers(part.first_vertex, part.first_vertex + part.own);
        if (changes != nullptr && numbers.are_unchanged()) {
            return;
        }
        part.lo = MeshLayout::kEmptyLo;
        part.hi = MeshLayout::kEmptyHi;
        for (std::size_t v = 0; v < part.number.size(); ++v) {
            const std::uint32_t number = part.number[v];
            if (number == kNoNumber || number < part.first_vertex ||
                (changes != nullptr &&
                 (numbers(number) == MeshChanges::kGone || changes->moves(number)))) {
                continue;
            }
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const float x = part.slab.positions[v][axis] + 0.0F;  // no negative zero
                part.lo[axis] = std::min(part.lo[axis], x);
                part.hi[axis] = std::max(part.hi[axis], x);
            }
        }
    });
    layout.lo = MeshLayout::kEmptyLo;
    layout.hi = MeshLayout::kEmptyHi;
    const auto widen = [&](const std::array<float, 3>& lo, const std::array<float, 3>& hi) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            layout.lo[axis] = std::min(layout.lo[axis], lo[axis] + 0.0F);
            layout.hi[axis] = std::max(layout.hi[axis], hi[axis] + 0.0F);
        }
    };
    for (const Part& part : parts_) {
        widen(part.lo, part.hi);
    }
    for (const MeshChanges::Moved& m :
         changes == nullptr ? std::span<const MeshChanges::Moved>{} : changes->moved()) {
        if (changes->vertex_now(m.vertex) != MeshChanges::kGone) {
            widen(m.to, m.to);
        }
    }
}

void SlabJoin::put(Part& part, const MeshRoom& mesh, const MeshChanges& changes,
                   const SurfaceSums& none, bool with_angles) {
    constexpr std::size_t kAtOnce = 4096;
    const auto& positions = part.slab.positions;
    const auto& triangles = part.slab.triangles;
    const auto is_own = [&](std::uint32_t number) {
        return number != kNoNumber && number >= part.first_vertex;
    };
    const auto own = changes.numbers(part.first_vertex, part.first_vertex + part.own);
    for (const std::uint32_t v : part.slab.not_alone) {
        const std::uint32_t now = is_own(part.number[v]) ? own(part.number[v]) : kNoNumber;
        if (now != kNoNumber) {
            part.found.not_alone.push_back(now);
        }
    }
    for (std::size_t v = 0; v < positions.size(); ++v) {
        const std::uint32_t before = part.number[v];
        if (!is_own(before)) {
            part.number[v] = before == kNoNumber ? kNoNumber : changes.vertex_now(before);
            continue;
        }
        part.number[v] = own(before);
        if (part.number[v] == MeshChanges::kGone) {
            continue;
        }
        mesh.vertices[part.number[v]] = positions[v];
        if (!mesh.normals.empty()) {
            mesh.normals[part.number[v]] = part.slab.normals[v];
            part.found.without_normal += has_no_direction(part.slab.normals[v]) ? 1 : 0;
        }
    }
    part.found.sums = none;
    part.found.cells = part.slab.cells;
    if (with_angles) {
        part.found.angles.emplace();
    }
    std::vector<std::array<std::uint64_t, 3>> corners;
    const auto put_unchanged = [&](std::size_t begin, std::size_t end) {
        for (; begin < end; begin += kAtOnce) {
            const auto some = std::span(triangles).subspan(begin, std::min(kAtOnce, end - begin));
            const std::uint64_t first = changes.triangle_now(part.first_triangle + begin);
            corners.clear();
            for (const auto& t : some) {
                const std::array<std::uint32_t, 3> numbers{part.number[t[0]], part.number[t[1]],
                                                           part.number[t[2]]};
                mesh.triangles[first + corners.size()] = numbers;
                corners.push_back({numbers[0], numbers[1], numbers[2]});
                if (with_angles) {
                    part.found.angles->add(
                        smallest_angle(positions[t[0]], positions[t[1]], positions[t[2]]));
                }
            }
            part.found.sums.add({first, corners, some, {0, positions}});
        }
    };
    std::size_t next = 0;
    for (const auto& c :
         changes.changed(part.first_triangle, part.first_triangle + triangles.size())) {
        const auto at = static_cast<std::size_t>(c.triangle - part.first_triangle);
        put_unchanged(next, at);
        next = at + 1;
    }
    put_unchanged(next, triangles.size());
}

namespace {

/// Writes the changed parts that SlabJoin::put() omits. REQUIRES: all slabs were put.
void put_changed(const MeshChanges& changes, JoinedMesh& joined) {
    const MeshRoom& mesh = joined.room;
    for (const MeshChanges::Moved& m : changes.moved()) {
        const std::uint32_t now = changes.vertex_now(m.vertex);
        if (now != MeshChanges::kGone) {
            mesh.vertices[now] = m.to;
            joined.moved.push_back(now);
        }
    }
    for (const MeshChanges::Changed& c : changes.changed()) {
        if (c.corners[0] == kNoTriangle) {
            continue;
        }
        const std::uint64_t number = changes.triangle_now(c.triangle);
        auto& t = mesh.triangles[number];
        std::transform(c.corners.begin(), c.corners.end(), t.begin(),
                       [&](std::uint32_t v) { return changes.vertex_now(v); });
        const std::array<std::uint64_t, 3> corners{t[0], t[1], t[2]};
        joined.sums.add({number, std::span(&corners, 1), std::span(&t, 1), {0, mesh.vertices}});
        if (joined.angles) {
            joined.angles->add(
                smallest_angle(mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]));
        }
    }
}

}  // namespace

JoinedMesh SlabJoin::finish(MeshLayout& layout, const MakeRoom& make_room, const Double3& min_step,
                            bool with_angles, const ScratchFolder& folder, Progress& progress) {
    tbb::parallel_for(std::size_t{0}, parts_.size(), [&](std::size_t i) { number_own(parts_[i]); });
    const Part* before = nullptr;
    for (Part& part : parts_) {
        part.first_vertex = layout.vertices;
        part.first_triangle = layout.elements;
        layout.vertices += part.own;
        layout.elements += part.slab.triangles.size();
        for (Foreign& f : part.foreign) {
            f.number = static_cast<std::uint32_t>(before->first_vertex) + before->number[f.before];
        }
        before = &part;
    }
    if (layout.vertices > std::numeric_limits<std::uint32_t>::max()) {
        throw Error(
            ErrorKind::limit,
            fmt::format("the mesh has {} vertices, more than 32 bits can number", layout.vertices));
    }
    tbb::parallel_for(std::size_t{0}, parts_.size(),
                      [&](std::size_t i) { number_in_mesh(parts_[i]); });
    find_box(nullptr, layout);
    std::vector<NumberedSlab> slabs;
    std::transform(parts_.begin(), parts_.end(), std::back_inserter(slabs), numbered);
    const MeshChanges changes(slabs, layout.lo, layout.hi, min_step, folder, progress);
    if (!changes.changed().empty()) {
        layout.vertices -= changes.gone_vertices();
        layout.elements -= changes.gone_triangles();
        find_box(&changes, layout);
    }
    const MeshRoom room = make_room(layout);
    const SurfaceSums none(layout);
    progress.begin("join slabs", parts_.size(), "slabs");
    tbb::parallel_for(std::size_t{0}, parts_.size(), [&](std::size_t i) {
        progress.check();
        put(parts_[i], room, changes, none, with_angles);
        parts_[i].slab = {};
        parts_[i].number = {};
        progress.advance(1);
    });
    JoinedMesh joined{0, 0, room, {}, none, {}, changes.mended(), {}};
    if (with_angles) {
        joined.angles.emplace();
    }
    for (const Part& part : parts_) {
        joined.cells += part.found.cells;
        joined.without_normal += part.found.without_normal;
        joined.not_alone.insert(joined.not_alone.end(), part.found.not_alone.begin(),
                                part.found.not_alone.end());
        joined.sums.add(part.found.sums);
        if (with_angles) {
            joined.angles->add(*part.found.angles);
        }
    }
    put_changed(changes, joined);
    parts_.clear();
    return joined;
}

namespace {

constexpr std::size_t kAtOnce = std::size_t{1} << 16U;

/// Calls work(first, count) for pieces of `size` rows, from all threads of the arena.
template <class Work>
void each_piece(std::size_t size, const Work& work) {
    tbb::parallel_for(std::size_t{0}, (size + kAtOnce - 1) / kAtOnce, [&](std::size_t piece) {
        work(piece * kAtOnce, std::min(kAtOnce, size - piece * kAtOnce));
    });
}

/// Like ApartStage. `vertices`: sorted by place; corners(t): of triangle t of `triangles`.
template <class Corners>
ApartVertices move_apart(std::span<std::array<float, 3>> positions, std::uint64_t triangles,
                         const Corners& corners, const PlacedVertices& vertices,
                         const MeshLayout& layout, const VolumeDescription& volume,
                         const ScratchFolder& folder, Progress& progress) {
    TouchedTriangles touched(vertices.all(), positions.size(), folder);
    touched.gather_among(triangles, corners, progress);
    const LatticeSteps steps = header_of(volume).steps();
    const Double3 least = steps.min_along();
    ApartRange range;
    range.moves = is_short_step(
        step_apart(coordinate_rounding(volume.nodes, steps, volume.origin), kMinApart));
    range.lo = layout.lo;
    range.hi = layout.hi;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto last = static_cast<double>(volume.nodes[static_cast<int>(axis)] - 1);
        range.min_step[axis] = least[axis] * kMinApart;
        range.low_faces[axis] = static_cast<float>(volume.origin[axis]);
        range.high_faces[axis] = static_cast<float>(volume.origin[axis] + steps.offset(axis, last));
    }
    return keep_apart(positions, touched.all(), vertices.all(), range, folder, progress);
}

/// For a mesh whose vertices were moved: measures and quality, and triangles without area.
SettledMesh measured(const MeshRoom& mesh, const MeshLayout& layout, bool with_quality) {
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
    SettledMesh settled;
    settled.zero_area = zero_area;
    settled.measures = sums.measures();
    if (with_quality) {
        settled.quality = angles.quality();
    }
    return settled;
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

/// Whether one of `moved` has come to the place of another vertex.
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

/// All vertices of a mesh with their positions. Throws Error{io}.
PlacedVertices all_placed(const MeshRoom& mesh, const ScratchFolder& folder) {
    ScratchFile numbers(folder);
    numbers.map(mesh.vertices.size() * sizeof(std::uint32_t));
    const auto all = numbers.as<std::uint32_t>().first(mesh.vertices.size());
    std::iota(all.begin(), all.end(), 0U);
    return {mesh.vertices, all, folder};
}

}  // namespace

SettledMesh settle_mesh(const JoinedMesh& joined, const MeshLayout& layout,
                        const VolumeDescription& volume, const ScratchFolder& folder,
                        Progress& progress) {
    const MeshRoom& mesh = joined.room;
    SettledMesh settled;
    const bool have_met = share_places(mesh, joined.moved);
    if (have_met || !are_all_alone(mesh, joined.not_alone)) {
        const PlacedVertices vertices =
            have_met || joined.mended.found > 0
                ? all_placed(mesh, folder)
                : PlacedVertices(mesh.vertices, joined.not_alone, folder);
        sort_by_place(vertices.all());
        const ApartVertices apart = move_apart(
            mesh.vertices, mesh.triangles.size(),
            [&](std::uint64_t t) {
                const auto& c = mesh.triangles[t];
                return ElementCorners{c[0], c[1], c[2]};
            },
            vertices, layout, volume, folder, progress);
        settled = measured(mesh, layout, joined.angles.has_value());
        settled.apart = {apart.moved, apart.left};
        settled.moved_apart = max_in_lattice(apart.by, header_of(volume).steps());
    } else {
        settled.zero_area = joined.mended.left;
        settled.measures = joined.sums.measures();
        settled.quality = joined.angles ? std::optional(joined.angles->quality()) : std::nullopt;
    }
    settled.moved_by_mending = max_in_lattice(joined.mended.moved, header_of(volume).steps());
    if (joined.without_normal > 0) {
        complete_normals(mesh.vertices, mesh.triangles, mesh.normals, folder, progress);
    }
    return settled;
}

}  // namespace isonest::detail
