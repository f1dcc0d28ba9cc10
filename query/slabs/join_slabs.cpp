#include "query/slabs/join_slabs.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>

#include <isonest/error.h>
#include <isonest/mesh_sink.h>

#include "query/mesh/zero_area.h"
#include "store/base/union_find.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kNoNumber = 0xFFFFFFFFU;
constexpr std::uint32_t kForeign = 0xFFFFFFFEU;

/// A vertex with a name, in one of two slabs: of vertices that are the same, the first one holds.
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

/// Vertices with one name are the same, and those with two names join what has either.
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
    part.number.assign(part.slab.positions.size(), kNoNumber);
    for (const Foreign& f : part.foreign) {
        part.number[f.vertex] = kForeign;
    }
    part.lo = MeshLayout::kEmptyLo;
    part.hi = MeshLayout::kEmptyHi;
    for (const auto& t : triangles) {
        for (const std::uint32_t v : t) {
            if (part.number[v] != kNoNumber) {
                continue;
            }
            part.number[v] = part.own++;
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const float x = part.slab.positions[v][axis] + 0.0F;  // no negative zero
                part.lo[axis] = std::min(part.lo[axis], x);
                part.hi[axis] = std::max(part.hi[axis], x);
            }
        }
    }
}

void SlabJoin::put(Part& part, const MeshRoom& mesh, const SurfaceSums& none, bool with_angles) {
    constexpr std::size_t kAtOnce = 4096;
    const auto& positions = part.slab.positions;
    const auto& triangles = part.slab.triangles;
    const auto first = static_cast<std::uint32_t>(part.first_vertex);
    for (std::size_t v = 0; v < positions.size(); ++v) {
        if (part.number[v] < kForeign) {
            part.number[v] += first;
            mesh.vertices[part.number[v]] = positions[v];
            if (!mesh.normals.empty()) {
                mesh.normals[part.number[v]] = part.slab.normals[v];
            }
        }
    }
    for (const std::uint32_t v : part.slab.not_alone) {
        if (part.number[v] < kForeign) {
            part.found.not_alone.push_back(part.number[v]);
        }
    }
    for (const Foreign& f : part.foreign) {
        part.number[f.vertex] = f.number;
    }
    part.found.sums = none;
    part.found.cells = part.slab.cells;
    if (with_angles) {
        part.found.angles.emplace();
    }
    std::vector<std::array<std::uint64_t, 3>> corners;
    for (std::size_t begin = 0; begin < triangles.size(); begin += kAtOnce) {
        const auto some =
            std::span(triangles).subspan(begin, std::min(kAtOnce, triangles.size() - begin));
        corners.clear();
        for (const auto& t : some) {
            const std::array<std::uint32_t, 3> numbers{part.number[t[0]], part.number[t[1]],
                                                       part.number[t[2]]};
            mesh.triangles[part.first_triangle + begin + corners.size()] = numbers;
            corners.push_back({numbers[0], numbers[1], numbers[2]});
            part.found.zero_area_triangles +=
                has_no_area(positions[t[0]], positions[t[1]], positions[t[2]]) ? 1 : 0;
            if (with_angles) {
                part.found.angles->add(
                    smallest_angle(positions[t[0]], positions[t[1]], positions[t[2]]));
            }
        }
        part.found.sums.add({begin, corners, some, {0, positions}});
    }
}

JoinedMesh SlabJoin::finish(MeshLayout& layout, const MakeRoom& make_room, bool with_angles,
                            Progress& progress) {
    tbb::parallel_for(std::size_t{0}, parts_.size(), [&](std::size_t i) { number_own(parts_[i]); });
    layout.lo = MeshLayout::kEmptyLo;
    layout.hi = MeshLayout::kEmptyHi;
    const Part* before = nullptr;
    for (Part& part : parts_) {
        part.first_vertex = layout.vertices;
        part.first_triangle = layout.elements;
        layout.vertices += part.own;
        layout.elements += part.slab.triangles.size();
        for (std::size_t axis = 0; axis < 3; ++axis) {
            layout.lo[axis] = std::min(layout.lo[axis], part.lo[axis]);
            layout.hi[axis] = std::max(layout.hi[axis], part.hi[axis]);
        }
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
    const MeshRoom room = make_room(layout);
    const SurfaceSums none(layout);
    progress.begin("join slabs", parts_.size(), "slabs");
    tbb::parallel_for(std::size_t{0}, parts_.size(), [&](std::size_t i) {
        progress.check();
        put(parts_[i], room, none, with_angles);
        parts_[i].slab = {};
        parts_[i].number = {};
        progress.advance(1);
    });
    JoinedMesh joined{0, 0, room, {}, none, {}};
    if (with_angles) {
        joined.angles.emplace();
    }
    for (const Part& part : parts_) {
        joined.cells += part.found.cells;
        joined.zero_area_triangles += part.found.zero_area_triangles;
        joined.not_alone.insert(joined.not_alone.end(), part.found.not_alone.begin(),
                                part.found.not_alone.end());
        joined.sums.add(part.found.sums);
        if (with_angles) {
            joined.angles->add(*part.found.angles);
        }
    }
    parts_.clear();
    return joined;
}

}  // namespace isonest::detail
