#include "query/simplify/collapse/placed_collapse.h"

#include <algorithm>

#include "query/mesh/zero_area.h"

namespace isonest::detail {

bool PlacedCollapse::is_inside_box(const std::array<float, 3>& p) const {
    for (std::size_t axis = 0; axis < 3; ++axis) {
        // Where there is no box, it is not a number.
        if (p[axis] <= box_.lo[axis] || p[axis] >= box_.hi[axis]) {
            return false;
        }
    }
    return true;
}

void PlacedCollapse::gather(const CornerMesh::Ring& ring) {
    for (const std::uint32_t h : ring.halves) {
        if (std::find(before_.begin(), before_.end(), h / 3) == before_.end()) {
            before_.push_back(h / 3);
        }
    }
}

/// False: it turns too far, or has no area.
bool PlacedCollapse::add(std::uint32_t triangle, const StarCollapse& half) {
    Placed placed{triangle, mesh_.corners(triangle), {}, {}};
    std::array<std::array<float, 3>, 3> at{};
    for (std::size_t i = 0; i < 3; ++i) {
        std::uint32_t& v = placed.corners[i];
        v = v == from_ ? to_ : v;
        at[i] = v == to_ ? place_ : positions_[v];
        placed.at[i] = point_at(at[i]);
    }
    placed.normal = StarCollapse::normal(placed.at[0], placed.at[1], placed.at[2]);
    const StarCollapse::Normal& old = half.normal_of(triangle);
    constexpr StarCollapse::Normal kNone{};
    if (placed.normal == kNone || has_no_area(at[0], at[1], at[2]) ||
        (old != kNone && StarCollapse::cosine(old, placed.normal) < StarCollapse::kLeastCosine)) {
        return false;
    }
    after_.push_back(placed);
    return true;
}

bool PlacedCollapse::look(const StarCollapse& half, const std::array<float, 3>& place) {
    from_ = half.ring().middle;
    to_ = half.vertex(0);
    place_ = place;
    before_.clear();
    gone_.clear();
    after_.clear();
    if (half.faces_of(from_) != 0 || half.faces_of(to_) != 0 || !is_inside_box(place) ||
        place == positions_[to_]) {
        return false;
    }
    mesh_.ring_of(to_, ring_);
    if (!half.ring().is_closed || !ring_.is_closed) {
        return false;
    }
    gather(half.ring());
    gather(ring_);
    for (const std::uint32_t t : before_) {
        const PatchTriangle c = mesh_.corners(t);
        const bool has_from = std::find(c.begin(), c.end(), from_) != c.end();
        const bool has_to = std::find(c.begin(), c.end(), to_) != c.end();
        if (has_from && has_to) {
            gone_.push_back(t);
        } else if (!add(t, half)) {
            return false;
        }
    }
    return true;
}

bool PlacedCollapse::is_gone(std::uint32_t triangle) const {
    return std::find(gone_.begin(), gone_.end(), triangle) != gone_.end();
}

/// The other half of a changed triangle's edge, once the edge is collapsed.
std::uint32_t PlacedCollapse::across(std::uint32_t half_edge) const {
    const std::uint32_t other = mesh_.across(half_edge);
    if (other == CornerMesh::kNone || !is_gone(other / 3)) {
        return other;
    }
    // Of a triangle that goes, the two edges that stay become one.
    const std::uint32_t next = CornerMesh::next(other);
    const auto is_end = [&](std::uint32_t v) { return v == from_ || v == to_; };
    const bool is_collapsed = is_end(mesh_.start(next)) && is_end(mesh_.end(next));
    return mesh_.across(is_collapsed ? CornerMesh::previous(other) : next);
}

bool PlacedCollapse::has_no_new_fold(const StarCollapse& half, float least) const {
    float before = 1;
    for (const std::uint32_t t : before_) {
        for (std::uint32_t h = 3 * t; h < 3 * t + 3; ++h) {
            const std::uint32_t other = mesh_.across(h);
            if (other != CornerMesh::kNone) {
                before = std::min(
                    before, StarCollapse::cosine(half.normal_of(t), half.normal_of(other / 3)));
            }
        }
    }
    const auto now = [&](std::uint32_t triangle) -> const StarCollapse::Normal& {
        const auto placed = std::find_if(after_.begin(), after_.end(),
                                         [&](const Placed& p) { return p.triangle == triangle; });
        return placed == after_.end() ? half.normal_of(triangle) : placed->normal;
    };
    float after = 1;
    for (const Placed& placed : after_) {
        for (std::uint32_t h = 3 * placed.triangle; h < 3 * placed.triangle + 3; ++h) {
            const std::uint32_t other = across(h);
            if (other != CornerMesh::kNone) {
                after = std::min(after, StarCollapse::cosine(placed.normal, now(other / 3)));
            } else if (shared_[mesh_.start(h)] && shared_[mesh_.end(h)]) {
                // What lies across may turn at the same time.
                return false;
            }
        }
    }
    return after >= least || after >= before;
}

}  // namespace isonest::detail
