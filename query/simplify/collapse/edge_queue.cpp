#include "query/simplify/collapse/edge_queue.h"

#include <algorithm>

namespace isonest::detail {
namespace {

constexpr double kBorderWeight = 1;  ///< of the plane through a border edge, perpendicular to the
                                     ///< triangle

}  // namespace

EdgeQueue::EdgeQueue(std::span<const std::array<float, 3>> positions, const CornerMesh& mesh,
                     float most)
    : positions_(positions),
      mesh_(mesh),
      max_(most),
      quadrics_(positions.size()),
      version_(positions.size()),
      bins_(bin_of(most) + 1) {
    for (std::size_t a = 0; a < 3; ++a) {
        origin_[a] = positions.empty() ? 0 : static_cast<double>(positions[0][a]);
    }
    for (std::uint32_t t = 0; t < mesh.triangles(); ++t) {
        if (!mesh.is_gone(t)) {
            add_quadrics(t);
        }
    }
}

void EdgeQueue::add_quadrics(std::uint32_t triangle) {
    const PatchTriangle t = mesh_.corners(triangle);
    const std::array<Double3, 3> p{at(t[0]), at(t[1]), at(t[2])};
    Double3 n = cross(minus(p[1], p[0]), minus(p[2], p[0]));
    const double area = length(n);
    if (!(area > 0)) {
        return;
    }
    n = {n[0] / area, n[1] / area, n[2] / area};
    Quadric plane;
    plane.add_plane(n, p[0], area);
    for (std::size_t i = 0; i < 3; ++i) {
        const std::size_t j = (i + 1) % 3;
        quadrics_[t[i]].add(plane);
        const Double3 edge = minus(p[j], p[i]);
        const double size = square(edge);
        if (mesh_.across(3 * triangle + static_cast<std::uint32_t>(i)) == CornerMesh::kNone &&
            size > 0) {
            Double3 side = cross(edge, n);
            const double width = length(side);
            side = {side[0] / width, side[1] / width, side[2] / width};
            Quadric upright;
            upright.add_plane(side, p[i], kBorderWeight * size);
            quadrics_[t[i]].add(upright);
            quadrics_[t[j]].add(upright);
        }
    }
}

void EdgeQueue::push(const Edge& edge) {
    const std::size_t of = bin_of(edge.square_error);
    if (of >= bins_.size()) {
        return;
    }
    std::uint32_t place = free_;
    if (place == CornerMesh::kNone) {
        place = static_cast<std::uint32_t>(waiting_.size());
        waiting_.push_back({edge, CornerMesh::kNone});
    } else {
        free_ = waiting_[place].next;
        waiting_[place] = {edge, CornerMesh::kNone};
    }
    Bin& bin = bins_[of];
    if (bin.first == CornerMesh::kNone) {
        bin.first = place;
    } else {
        waiting_[bin.last].next = place;
    }
    bin.last = place;
    lowest_ = std::min(lowest_, of);
}

/// Adds the next edge from the ring's middle after the one with this error to this vertex.
void EdgeQueue::push_next(const CornerMesh::Ring& ring, float after, std::uint32_t after_to) {
    const std::uint32_t from = ring.middle;
    Edge best{max_from(from), from, CornerMesh::kNone, 2 * version_[from] + 1};
    for (const std::uint32_t to : ring.vertices) {
        const float error = square_error(from, to);
        if ((error > after || (error == after && to > after_to)) &&
            (error < best.square_error || (error == best.square_error && to < best.to))) {
            best.square_error = error;
            best.to = to;
        }
    }
    if (best.to != CornerMesh::kNone) {
        push(best);
    }
}

void EdgeQueue::add(std::uint32_t v) {
    mesh_.ring_of(v, ring_);
    push_next(ring_, -1, 0);
}

std::optional<EdgeQueue::Edge> EdgeQueue::next() {
    for (; lowest_ < bins_.size(); ++lowest_) {
        while (bins_[lowest_].first != CornerMesh::kNone) {
            Bin& bin = bins_[lowest_];
            const std::uint32_t place = bin.first;
            Waiting& w = waiting_[place];
            bin.first = w.next;
            w.next = free_;
            free_ = place;
            if (w.edge.version() == version_[w.edge.from]) {
                return w.edge;
            }
        }
    }
    return std::nullopt;
}

void EdgeQueue::stays(const Edge& edge, const CornerMesh::Ring& ring) {
    if (edge.has_others()) {
        push_next(ring, edge.square_error, edge.to);
    }
}

void EdgeQueue::collapsed(std::uint32_t from, const CornerMesh::Ring& ring,
                          const std::vector<bool>& locked) {
    const std::uint32_t to = ring.middle;
    ++version_[from];
    quadrics_[to].add(quadrics_[from]);
    ++version_[to];
    for (const std::uint32_t v : ring.vertices) {
        if (!locked[v]) {
            const float error = square_error(v, to);
            if (error <= max_from(v)) {
                push({error, v, to, 2 * version_[v]});
            }
        }
    }
    if (!locked[to]) {
        push_next(ring, -1, 0);
    }
}

}  // namespace isonest::detail
