#include "query/slabs/mend_slabs.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <limits>

namespace isonest::detail {
namespace {

using SlabCorners = std::array<std::uint32_t, 3>;

/// A triangle with one of some vertices.
struct TouchedTriangle {
    std::uint64_t number;
    SlabCorners corners;  ///< numbers in the mesh
    std::array<std::array<float, 3>, 3> at;
};

void sort_unique(std::vector<std::uint32_t>& vertices) {
    std::sort(vertices.begin(), vertices.end());
    vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
}

/// The index in ascending numbers. REQUIRES: the number is present.
std::uint32_t place_among(std::span<const std::uint32_t> numbers, std::uint32_t number) {
    return static_cast<std::uint32_t>(std::lower_bound(numbers.begin(), numbers.end(), number) -
                                      numbers.begin());
}

SlabCorners corners_of(const NumberedSlab& slab, const SlabCorners& t) {
    return {slab.number[t[0]], slab.number[t[1]], slab.number[t[2]]};
}

std::vector<TouchedTriangle> touched_in(const NumberedSlab& slab,
                                        std::span<const std::uint32_t> vertices) {
    std::vector<TouchedTriangle> touched;
    std::vector<bool> is_one(slab.number.size());
    bool any = false;
    const auto place = [&](std::uint64_t number) {
        return std::partition_point(vertices.begin(), vertices.end(),
                                    [&](std::uint32_t v) { return v < number; });
    };
    const std::span own(place(slab.first_vertex), place(slab.first_vertex + slab.number.size()));
    for (std::size_t v = 0; v < slab.number.size(); ++v) {
        const std::uint32_t number = slab.number[v];
        const auto among = number >= slab.first_vertex ? own : vertices;
        if (number != NumberedSlab::kNoNumber &&
            std::binary_search(among.begin(), among.end(), number)) {
            is_one[v] = any = true;
        }
    }
    for (std::size_t i = 0; any && i < slab.triangles.size(); ++i) {
        const SlabCorners& t = slab.triangles[i];
        if (is_one[t[0]] || is_one[t[1]] || is_one[t[2]]) {
            touched.push_back({slab.first_triangle + i,
                               corners_of(slab, t),
                               {slab.positions[t[0]], slab.positions[t[1]], slab.positions[t[2]]}});
        }
    }
    return touched;
}

/// All triangles of the mesh with one of the vertices, which are ascending; in order.
std::vector<TouchedTriangle> touched_by(std::span<const NumberedSlab> slabs,
                                        std::span<const std::uint32_t> vertices,
                                        Progress& progress) {
    std::vector<std::vector<TouchedTriangle>> of_slab(slabs.size());
    tbb::parallel_for(std::size_t{0}, slabs.size(), [&](std::size_t i) {
        progress.check();
        of_slab[i] = touched_in(slabs[i], vertices);
    });
    std::vector<TouchedTriangle> all;
    for (const auto& some : of_slab) {
        all.insert(all.end(), some.begin(), some.end());
    }
    return all;
}

}  // namespace

MeshChanges::MeshChanges(std::span<const NumberedSlab> slabs, const std::array<float, 3>& lo,
                         const std::array<float, 3>& hi, const Double3& min_step,
                         const ScratchFolder& folder, Progress& progress) {
    std::vector<std::uint32_t> of_flat;
    for (const NumberedSlab& slab : slabs) {
        for (const std::uint32_t i : slab.flat) {
            const SlabCorners corners = corners_of(slab, slab.triangles[i]);
            of_flat.insert(of_flat.end(), corners.begin(), corners.end());
        }
    }
    if (of_flat.empty()) {
        return;
    }
    sort_unique(of_flat);
    // Mending reads only triangles around corners of triangles without area, and only compares the
    // order of vertices or triangles.
    const std::vector<TouchedTriangle> around = touched_by(slabs, of_flat, progress);
    std::vector<std::uint32_t> number;
    for (const TouchedTriangle& t : around) {
        number.insert(number.end(), t.corners.begin(), t.corners.end());
    }
    sort_unique(number);
    std::vector<std::array<float, 3>> positions(number.size());
    std::vector<SlabCorners> triangles;
    triangles.reserve(around.size());
    for (const TouchedTriangle& t : around) {
        SlabCorners& corners = triangles.emplace_back();
        for (std::size_t i = 0; i < 3; ++i) {
            corners[i] = place_among(number, t.corners[i]);
            positions[corners[i]] = t.at[i];
        }
    }
    std::vector<std::uint32_t> moved;
    mended_ = mend_triangles(positions, triangles, lo, hi, min_step, moved, folder, progress);
    sort_unique(moved);
    for (const std::uint32_t v : moved) {
        moved_.push_back({number[v], positions[v]});
        vertices_.push_back(number[v]);
    }
    std::vector<Changed> others;
    for (std::size_t i = 0; i < triangles.size(); ++i) {
        Changed t{around[i].number, triangles[i]};
        for (std::uint32_t& v : t.corners) {
            v = v == kNoTriangle ? kNoTriangle : number[v];
        }
        if (t.corners != around[i].corners) {
            others.push_back(t);
            for (const SlabCorners& corners : {t.corners, around[i].corners}) {
                std::copy_if(corners.begin(), corners.end(), std::back_inserter(vertices_),
                             [](std::uint32_t v) { return v != kNoTriangle; });
            }
        }
        if (t.corners[0] == kNoTriangle) {
            gone_.push_back(t.triangle);
        }
    }
    sort_unique(vertices_);

    // Triangles with a moved vertex have also changed. Determine the first use of each vertex now.
    constexpr std::uint64_t kNever = std::numeric_limits<std::uint64_t>::max();
    std::vector<std::uint64_t> first_named(vertices_.size(), kNever);
    auto other = others.begin();
    for (const TouchedTriangle& t : touched_by(slabs, vertices_, progress)) {
        Changed now{t.number, t.corners};
        const bool is_other = other != others.end() && other->triangle == t.number;
        if (is_other) {
            now = *other++;
        }
        if (now.corners[0] == kNoTriangle) {
            changed_.push_back(now);
            continue;
        }
        if (is_other || std::any_of(now.corners.begin(), now.corners.end(),
                                    [&](std::uint32_t v) { return moves(v); })) {
            changed_.push_back(now);
        }
        for (std::size_t i = 0; i < 3; ++i) {
            const std::uint32_t place = place_among(vertices_, now.corners[i]);
            if (place < vertices_.size() && vertices_[place] == now.corners[i]) {
                first_named[place] = std::min(first_named[place], 3 * t.number + i);
            }
        }
    }
    renumber(slabs, first_named);
}

/// `first_named`: for each index in vertices_, 3 * triangle + corner of the first use; the largest
/// number if there is none.
void MeshChanges::renumber(std::span<const NumberedSlab> slabs,
                           std::span<const std::uint64_t> first_named) {
    std::vector<std::uint32_t> order;
    for (std::uint32_t i = 0; i < vertices_.size(); ++i) {
        if (first_named[i] != std::numeric_limits<std::uint64_t>::max()) {
            order.push_back(i);
        }
    }
    std::sort(order.begin(), order.end(),
              [&](std::uint32_t a, std::uint32_t b) { return first_named[a] < first_named[b]; });
    gone_vertices_ = vertices_.size() - order.size();
    now_.assign(vertices_.size(), kGone);
    ahead_.reserve(order.size());
    auto next = order.begin();
    for (const NumberedSlab& slab : slabs) {
        // Number of vertices used before the corner: numbers ascend in that order.
        std::uint64_t named = slab.first_vertex;
        std::uint64_t corner = 3 * slab.first_triangle;
        const std::uint64_t end = corner + 3 * slab.triangles.size();
        for (; next != order.end() && first_named[*next] < end; ++next) {
            for (; corner < first_named[*next]; ++corner) {
                const std::uint64_t i = corner - 3 * slab.first_triangle;
                named =
                    std::max(named, std::uint64_t{slab.number[slab.triangles[i / 3][i % 3]]} + 1);
            }
            const std::uint64_t others_ahead =
                named - place_among(vertices_, static_cast<std::uint32_t>(named));
            now_[*next] = static_cast<std::uint32_t>(others_ahead + ahead_.size());
            ahead_.push_back(static_cast<std::uint32_t>(named));
        }
    }
}

std::span<const MeshChanges::Changed> MeshChanges::changed(std::uint64_t first,
                                                           std::uint64_t end) const {
    const auto place = [&](std::uint64_t triangle) {
        return std::lower_bound(
            changed_.begin(), changed_.end(), triangle,
            [](const Changed& c, std::uint64_t number) { return c.triangle < number; });
    };
    return {place(first), place(end)};
}

MeshChanges::Numbers MeshChanges::numbers(std::uint64_t first, std::uint64_t end) const {
    const auto within = [&](std::span<const std::uint32_t> ascending) {
        return std::span(std::lower_bound(ascending.begin(), ascending.end(), first),
                         std::lower_bound(ascending.begin(), ascending.end(), end));
    };
    Numbers numbers;
    numbers.vertices_ = within(vertices_);
    numbers.ahead_ = within(ahead_);
    const auto place = static_cast<std::size_t>(numbers.vertices_.data() - vertices_.data());
    const auto ahead = static_cast<std::size_t>(numbers.ahead_.data() - ahead_.data());
    numbers.now_ = std::span(now_).subspan(place, numbers.vertices_.size());
    numbers.shift_ = static_cast<std::uint32_t>(ahead) - static_cast<std::uint32_t>(place);
    return numbers;
}

std::uint64_t MeshChanges::triangle_now(std::uint64_t before) const {
    return before - static_cast<std::uint64_t>(
                        std::lower_bound(gone_.begin(), gone_.end(), before) - gone_.begin());
}

bool MeshChanges::moves(std::uint32_t vertex_before) const {
    const auto at =
        std::lower_bound(moved_.begin(), moved_.end(), vertex_before,
                         [](const Moved& m, std::uint32_t number) { return m.vertex < number; });
    return at != moved_.end() && at->vertex == vertex_before;
}

}  // namespace isonest::detail
