// Collapses the edges of a patch, whatever it is that the collapses have to keep.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "query/simplify/collapse/collapse_order.h"
#include "query/simplify/collapse/collapsing_patch.h"
#include "query/simplify/collapse/patch_topology.h"
#include "query/simplify/patch.h"

namespace isonest::detail {

/// The vertices of all triangles that have to stay, those that other patches share, and those of
/// triangles at vertices around which the triangles are neither a disk nor half of one.
inline std::vector<bool> locked_vertices(const Patch& patch, const std::vector<Link>& links) {
    std::vector<bool> locked = patch.shared;
    for (std::size_t i = 0; i < patch.triangles.size(); ++i) {
        const PatchTriangle& t = patch.triangles[i];
        if (patch.stay[i] != Stay::no || std::any_of(t.begin(), t.end(), [&](std::uint32_t v) {
                return links[v].shape == LinkShape::tangled;
            })) {
            for (const std::uint32_t v : t) {
                locked[v] = true;
            }
        }
    }
    return locked;
}

/// Collapses what is allowed, in the order's order, until no edge waits: fits(from, to) says
/// whether a collapse that leaves the topology may be made, took() that it is being made.
template <class Fits, class Took>
void collapse_edges(const Patch& patch, const std::vector<bool>& locked, CollapsingPatch& mesh,
                    CollapseOrder& order, const Fits& fits, const Took& took) {
    std::vector<bool> waits(patch.positions.size());
    for (std::size_t i = 0; i < patch.triangles.size(); ++i) {
        for (const std::uint32_t v : patch.triangles[i]) {
            waits[v] = waits[v] || (!patch.tried[i] && !locked[v]);
        }
    }
    for (std::uint32_t v = 0; v < waits.size(); ++v) {
        if (waits[v]) {
            order.add(v);
        }
    }
    while (const auto next = order.next()) {
        if (mesh.is_allowed(next->from, next->to) && fits(next->from, next->to)) {
            took();
            mesh.collapse(next->from, next->to);
            order.collapsed(next->from, next->to);
        }
    }
}

inline std::vector<PatchTriangle> triangles_left(const CollapsingPatch& mesh) {
    std::vector<PatchTriangle> left;
    for (const PatchTriangle& t : mesh.triangles()) {
        if (!CollapsingPatch::is_gone(t)) {
            left.push_back(from_smallest(t));
        }
    }
    return left;
}

/// The result of make(locked), a simplifier with run(), triangles() and result(), with as many
/// vertices locked as it needs to leave the topology. Collapses that are allowed leave it; this is
/// where it is seen.
template <class Make>
auto with_same_topology(const Patch& patch, const Make& make) {
    std::vector<PatchTriangle> before(patch.triangles.size());
    std::transform(patch.triangles.begin(), patch.triangles.end(), before.begin(),
                   from_smallest<std::uint32_t>);
    const PatchTopology topology(patch, before);
    std::vector<bool> locked = locked_vertices(patch, topology.links());
    while (true) {
        auto simplifier = make(locked);
        simplifier.run();
        const std::vector<std::uint32_t> changes = topology.changes(simplifier.triangles());
        if (changes.empty()) {
            return simplifier.result();
        }
        if (std::all_of(changes.begin(), changes.end(),
                        [&](std::uint32_t v) { return locked[v]; })) {
            locked.assign(locked.size(), true);
        }
        for (const std::uint32_t v : changes) {
            locked[v] = true;
        }
    }
}

}  // namespace isonest::detail
