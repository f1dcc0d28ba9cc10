#include "query/simplify/collapse/collapsing_patch.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "query/mesh/zero_area.h"

namespace isonest::detail {
namespace {

/// A triangle's normal may not turn further than to this cosine by one collapse.
constexpr double kLeastCosine = 0.1;

/// There are few.
bool is_among(const std::vector<std::uint32_t>& vertices, std::uint32_t v) {
    return std::find(vertices.begin(), vertices.end(), v) != vertices.end();
}

}  // namespace

CollapsingPatch::CollapsingPatch(const Patch& patch, const std::vector<bool>& locked)
    : patch_(patch), locked_(locked), triangles_(patch.triangles), around_(patch.positions.size()) {
    origin_ = patch.point(triangles_.front()[0]);
    for (std::uint32_t i = 0; i < triangles_.size(); ++i) {
        for (const std::uint32_t v : triangles_[i]) {
            around_[v].push_back(i);
        }
    }
}

int CollapsingPatch::shared_triangles(std::uint32_t a, std::uint32_t b) const {
    return static_cast<int>(std::count_if(around_[a].begin(), around_[a].end(),
                                          [&](std::uint32_t i) { return has(triangles_[i], b); }));
}

void CollapsingPatch::neighbours_of(std::uint32_t v, std::vector<std::uint32_t>& found) const {
    found.clear();
    for (const std::uint32_t i : around_[v]) {
        for (const std::uint32_t w : triangles_[i]) {
            if (w != v && !is_among(found, w)) {
                found.push_back(w);
            }
        }
    }
}

bool CollapsingPatch::is_allowed(std::uint32_t from, std::uint32_t to) {
    const int edge = shared_triangles(from, to);
    if (edge == 0 || !stays_in_faces(from, to)) {
        return false;
    }
    neighbours_of(from, near_);
    neighbours_of(to, far_);
    common_.clear();
    std::copy_if(near_.begin(), near_.end(), std::back_inserter(common_),
                 [&](std::uint32_t v) { return is_among(far_, v); });
    const bool is_border = near_.size() != around_[from].size();
    if (static_cast<int>(common_.size()) != edge ||
        (is_border &&
         (edge != 1 || !border_stays_in_face(from, to) || is_last_triangle(from, to))) ||
        (locked_[to] && joins_locked(to))) {
        return false;
    }
    return std::none_of(around_[from].begin(), around_[from].end(), [&](std::uint32_t i) {
        return !has(triangles_[i], to) && (turns(i, from, to) || is_double(i, from, to));
    });
}

/// Whether all three edges of the only triangle of `from` are borders.
bool CollapsingPatch::is_last_triangle(std::uint32_t from, std::uint32_t to) const {
    return around_[from].size() == 1 && common_.size() == 1 && is_border(to, common_.front());
}

/// Whether an edge between two locked vertices would arise.
bool CollapsingPatch::joins_locked(std::uint32_t to) const {
    return std::any_of(near_.begin(), near_.end(), [&](std::uint32_t v) {
        return v != to && locked_[v] && !is_among(common_, v);
    });
}

unsigned CollapsingPatch::faces_of(std::uint32_t v) const {
    unsigned faces = 0;
    for (unsigned axis = 0; axis < 3; ++axis) {
        const float x = patch_.positions[v][axis];
        faces |= x == patch_.box.lo[axis] ? 1U << (2 * axis) : 0U;
        faces |= x == patch_.box.hi[axis] ? 2U << (2 * axis) : 0U;
    }
    return faces;
}

/// What lies in a face of the box, a border or a cap, stays in it.
bool CollapsingPatch::stays_in_faces(std::uint32_t from, std::uint32_t to) const {
    return (faces_of(from) & ~faces_of(to)) == 0;
}

/// A border goes on in the face in which it comes to `from`.
bool CollapsingPatch::border_stays_in_face(std::uint32_t from, std::uint32_t to) const {
    const unsigned faces = faces_of(from) & faces_of(to);
    return std::all_of(near_.begin(), near_.end(), [&](std::uint32_t v) {
        if (v == to || shared_triangles(from, v) != 1) {
            return true;
        }
        const unsigned others = faces_of(from) & faces_of(v);
        return (faces & others) != 0 || (faces == 0 && others == 0);
    });
}

bool CollapsingPatch::turns(std::uint32_t i, std::uint32_t from, std::uint32_t to) const {
    const PatchTriangle next = moved(triangles_[i], from, to);
    const Double3 before = normal(triangles_[i]);
    const Double3 after = normal(next);
    const double size = square(after);
    const auto& p = patch_.positions;
    return !(size > 0) || dot(before, after) < kLeastCosine * std::sqrt(size * square(before)) ||
           has_no_area(p[next[0]], p[next[1]], p[next[2]]);
}

/// Whether there is a triangle with these corners already.
bool CollapsingPatch::is_double(std::uint32_t i, std::uint32_t from, std::uint32_t to) const {
    const PatchTriangle next = moved(triangles_[i], from, to);
    return std::any_of(around_[to].begin(), around_[to].end(), [&](std::uint32_t other) {
        return std::all_of(next.begin(), next.end(),
                           [&](std::uint32_t v) { return has(triangles_[other], v); });
    });
}

void CollapsingPatch::collapse(std::uint32_t from, std::uint32_t to) {
    for (const std::uint32_t i : around_[from]) {
        PatchTriangle& t = triangles_[i];
        if (!has(t, to)) {
            t = moved(t, from, to);
            around_[to].push_back(i);
            continue;
        }
        for (const std::uint32_t v : t) {
            if (v != from) {
                auto& of = around_[v];
                of.erase(std::find(of.begin(), of.end(), i));
            }
        }
        t = {0, 0, 0};
    }
    around_[from].clear();
    around_[from].shrink_to_fit();
}

}  // namespace isonest::detail
