#include "query/simplify/collapse/corner_mesh.h"

#include <algorithm>
#include <numeric>

namespace isonest::detail {

CornerMesh::CornerMesh(std::size_t vertices, std::span<const PatchTriangle> triangles,
                       std::vector<bool>& locked)
    : start_(3 * triangles.size()),
      across_(3 * triangles.size(), kNone),
      first_(vertices, kNone),
      seen_in_(vertices) {
    // The half-edges from each vertex, one vertex after another.
    std::vector<std::uint32_t> begin(vertices + 1);
    for (std::size_t i = 0; i < triangles.size(); ++i) {
        for (std::size_t k = 0; k < 3; ++k) {
            start_[3 * i + k] = triangles[i][k];
            ++begin[triangles[i][k] + 1];
        }
    }
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    std::vector<std::uint32_t> from(start_.size());
    std::vector<std::uint32_t> place(begin.begin(), begin.end() - 1);
    for (std::uint32_t h = 0; h < start_.size(); ++h) {
        from[place[start_[h]]++] = h;
    }
    // If several half-edges have the same ends, none gets an opposite one: their ends are not
    // manifold.
    const auto only = [&](std::uint32_t a, std::uint32_t b) {
        std::uint32_t found = kNone;
        for (std::uint32_t i = begin[a]; i < begin[a + 1]; ++i) {
            if (end(from[i]) == b) {
                if (found != kNone) {
                    return kNone;
                }
                found = from[i];
            }
        }
        return found;
    };
    for (std::uint32_t h = 0; h < start_.size(); ++h) {
        if (across_[h] == kNone) {
            const std::uint32_t other = only(end(h), start_[h]);
            if (other != kNone && only(start_[h], end(h)) == h) {
                join(h, other);
            }
        }
    }
    std::vector<bool> tangled(vertices);
    for (std::uint32_t v = 0; v < vertices; ++v) {
        const std::uint32_t valence = begin[v + 1] - begin[v];
        if (valence == 0) {
            continue;
        }
        const auto edge = std::find_if(from.begin() + begin[v], from.begin() + begin[v + 1],
                                       [&](std::uint32_t h) { return across_[h] == kNone; });
        const bool is_closed = edge == from.begin() + begin[v + 1];
        first_[v] = is_closed ? from[begin[v]] : *edge;
        std::uint32_t reached = 0;
        std::uint32_t h = first_[v];
        do {
            ++reached;
            h = turned(h);
        } while (h != kNone && h != first_[v] && reached <= valence);
        tangled[v] = reached != valence || (is_closed && (h != first_[v] || valence < 3));
    }
    for (const PatchTriangle& t : triangles) {
        if (tangled[t[0]] || tangled[t[1]] || tangled[t[2]]) {
            locked[t[0]] = locked[t[1]] = locked[t[2]] = true;
        }
    }
}

void CornerMesh::join(std::uint32_t a, std::uint32_t b) {
    if (a != kNone) {
        across_[a] = b;
    }
    if (b != kNone) {
        across_[b] = a;
    }
}

void CornerMesh::ring_of(std::uint32_t v, Ring& ring) const {
    ring.vertices.clear();
    ring.halves.clear();
    ring.middle = v;
    ring.is_closed = true;
    const std::uint32_t first = first_[v];
    std::uint32_t h = first;
    while (h != kNone) {
        ring.vertices.push_back(end(h));
        ring.halves.push_back(h);
        const std::uint32_t turn = turned(h);
        if (turn == kNone) {
            ring.vertices.push_back(start_[previous(h)]);
            ring.is_closed = false;
            return;
        }
        h = turn == first ? kNone : turn;
    }
}

bool CornerMesh::keeps_topology(const Ring& ring, std::size_t place,
                                const std::vector<bool>& locked, std::uint32_t free) {
    const std::size_t count = ring.vertices.size();
    if (count < 3 || (!ring.is_closed && place != 0 && place + 1 != count)) {
        return false;
    }
    const std::uint32_t to = ring.vertices[place];
    ++question_;
    for (const std::uint32_t v : ring.vertices) {
        seen_in_[v] = question_;
    }
    std::size_t common = 0;
    const std::uint32_t first = first_[to];
    std::uint32_t h = first;
    do {
        common += seen_in_[end(h)] == question_ ? 1 : 0;
        const std::uint32_t turn = turned(h);
        if (turn == kNone) {
            common += seen_in_[start_[previous(h)]] == question_ ? 1 : 0;
        }
        h = turn;
    } while (h != kNone && h != first);
    if (common != (ring.is_closed ? 2U : 1U)) {
        return false;
    }
    const std::size_t after = place + 1 < count ? place + 1 : ring.is_closed ? 0 : count;
    const std::size_t before = place > 0 ? place - 1 : ring.is_closed ? count - 1 : count;
    if (locked[to]) {
        // Only the patch may use a new edge or triangle.
        bool others = false;
        for (std::size_t i = 0; i < count; ++i) {
            if (i != place && i != after && i != before) {
                others = true;
                if (locked[ring.vertices[i]] && ring.vertices[i] != free) {
                    return false;
                }
            }
        }
        if (!others && locked[ring.vertices[after]] && locked[ring.vertices[before]]) {
            return false;
        }
    }
    if (ring.is_closed && count == 3) {
        const std::uint32_t beyond = across_[next(ring.halves[after])];
        return beyond == kNone || start_[previous(beyond)] != to;
    }
    return true;
}

void CornerMesh::collapse(const Ring& ring, std::size_t place) {
    const std::size_t count = ring.vertices.size();
    const std::uint32_t to = ring.vertices[place];
    const auto take_out = [&](std::uint32_t h) {
        const std::uint32_t t = h / 3;
        start_[3 * t] = start_[3 * t + 1] = start_[3 * t + 2] = kNone;
    };
    const std::size_t last = ring.halves.size();
    const std::size_t behind = place > 0 ? place - 1 : ring.is_closed ? count - 1 : last;
    const std::uint32_t was_first = first_[to];
    for (std::size_t i = 0; i < last; ++i) {
        if (i != place && i != behind) {
            start_[ring.halves[i]] = to;
        }
    }
    if (place < last) {  // the triangle on the left of the edge
        const std::uint32_t h = ring.halves[place];
        const std::uint32_t x = start_[previous(h)];
        const std::uint32_t beyond = across_[next(h)];
        const std::uint32_t inner = across_[previous(h)];
        if (was_first == next(h)) {
            first_[to] = inner;
        }
        if (first_[x] == previous(h)) {
            first_[x] = beyond;
        }
        join(beyond, inner);
        take_out(h);
    }
    if (behind < last) {  // the one on the right
        const std::uint32_t g = ring.halves[behind];
        const std::uint32_t y = ring.vertices[behind];
        const std::uint32_t inner = across_[g];
        const std::uint32_t beyond = across_[next(g)];
        if (was_first == previous(g)) {
            first_[to] = ring.is_closed ? ring.halves[(place + 1) % count] : ring.halves[0];
        }
        if (first_[y] == next(g)) {
            first_[y] = inner;
        }
        join(beyond, inner);
        take_out(g);
    }
    first_[ring.middle] = kNone;
}

}  // namespace isonest::detail
