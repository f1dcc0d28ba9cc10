// Collapses the edges of a corner mesh one after the other, whatever it is that the collapses have
// to keep.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <limits>
#include <span>
#include <vector>

#include "query/simplify/collapse/corner_mesh.h"
#include "query/simplify/collapse/edge_queue.h"
#include "query/simplify/collapse/star_collapse.h"

namespace isonest::detail {

/// Cosine of the angle between normals from which on an edge is a fold where triangles are
/// measured: 120 degrees. At 72 degrees, 6 to 15 % more triangles are left, and hardly fewer edges
/// above 150 degrees.
inline constexpr float kMostMeasuredFold = -0.5F;

/// Whether a collapse makes no new fold and turns no triangle far, so that it is worth measuring
/// what its triangles are near to. REQUIRES: collapse.look() was true.
inline bool may_be_measured(StarCollapse& collapse) {
    return collapse.has_no_new_fold(kMostMeasuredFold) && collapse.turns_little();
}

/// Whether none of the corners is locked.
inline bool is_free(const PatchTriangle& t, const std::vector<bool>& locked) {
    return std::none_of(t.begin(), t.end(), [&](std::uint32_t v) { return locked[v]; });
}

/// What a collapse that is not made is due at.
inline constexpr float kNever = std::numeric_limits<float>::infinity();

/// Triangles that went, by the bin (edge_queue.h) of the largest square error until then.
using GoneTriangles = std::vector<std::uint64_t>;

inline void add_gone(GoneTriangles& to, const GoneTriangles& more) {
    to.resize(std::max(to.size(), more.size()));
    std::transform(more.begin(), more.end(), to.begin(), to.begin(), std::plus<>());
}

/// The limits at which no more than `most` of `triangles` are left, as if all else came as it did
/// when these went. REQUIRES: within `limits` no more than that are left.
inline CollapseLimits up_to(const CollapseLimits& limits, const GoneTriangles& gone,
                            std::uint64_t triangles, std::uint64_t most) {
    std::size_t bin = 0;
    for (std::uint64_t left = triangles; left > most; ++bin) {
        left -= gone[bin];
    }
    return {limits.distance, std::min(limits.square_estimate, end_of_bin(bin - 1))};
}

/// The vertices of all triangles that have to stay, and those that other patches share.
inline std::vector<bool> locked_vertices(const Patch& patch) {
    std::vector<bool> locked = patch.shared;
    for (std::size_t i = 0; i < patch.triangles.size(); ++i) {
        if (patch.stay[i] != Stay::no) {
            for (const std::uint32_t v : patch.triangles[i]) {
                locked[v] = true;
            }
        }
    }
    return locked;
}

/// Of each vertex whether it waits to be looked at: it is not locked, and has a triangle that was
/// not tried.
inline std::vector<bool> waiting_vertices(std::span<const PatchTriangle> triangles,
                                          const std::vector<bool>& tried,
                                          const std::vector<bool>& locked) {
    std::vector<bool> waits(locked.size());
    for (std::size_t i = 0; i < triangles.size(); ++i) {
        for (const std::uint32_t v : triangles[i]) {
            waits[v] = waits[v] || (!tried[i] && !locked[v]);
        }
    }
    return waits;
}

/// Collapses edges from the vertices that wait, in the queue's order, until none is left. due(edge)
/// looks at one with `star`, and says the square error at which it comes: kNever, now if that is
/// hardly more than the edge's own, else later, when it is asked again. take() makes the collapse,
/// and says how many triangles went.
template <class Due, class Take>
GoneTriangles collapse_stars(EdgeQueue& queue, const StarCollapse& star,
                             const std::vector<bool>& waits, const std::vector<bool>& locked,
                             const Due& due, const Take& take) {
    constexpr std::size_t kNoWait = 8;  // bins by which it is not worth waiting
    for (std::uint32_t v = 0; v < waits.size(); ++v) {
        if (waits[v]) {
            queue.add(v);
        }
    }
    GoneTriangles gone;
    std::size_t largest = 0;
    while (const auto edge = queue.next()) {
        const float at = due(*edge);
        const bool is_now = at < kNever && bin_of(at) <= queue.bin() + kNoWait;
        if (!is_now) {
            queue.stays(*edge, star.ring());
            if (at < kNever) {
                queue.defer(*edge, at);
            }
            continue;
        }
        largest = std::max(largest, queue.bin());
        if (largest >= gone.size()) {
            gone.resize(largest + 1);
        }
        gone[largest] += take();
        queue.collapsed(edge->from, star.ring(), locked);
    }
    return gone;
}

}  // namespace isonest::detail
