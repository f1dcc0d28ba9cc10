#include "query/simplify/collapse/collapse_order.h"

#include <limits>

namespace isonest::detail {
namespace {

constexpr std::uint32_t kNoTarget = std::numeric_limits<std::uint32_t>::max();
constexpr double kBorderWeight = 1;  ///< of the plane that stands on a border edge

}  // namespace

CollapseOrder::CollapseOrder(const Patch& patch, const CollapsingPatch& mesh,
                             const std::vector<bool>& locked, double error)
    : patch_(patch),
      mesh_(mesh),
      locked_(locked),
      most_(static_cast<float>(error * error)),
      quadrics_(patch.positions.size()),
      version_(patch.positions.size()) {
    origin_ = patch.point(mesh.triangles().front()[0]);
    for (const PatchTriangle& t : mesh.triangles()) {
        add_quadrics(t);
    }
}

void CollapseOrder::add_quadrics(const PatchTriangle& t) {
    Double3 n = cross(minus(at(t[1]), at(t[0])), minus(at(t[2]), at(t[0])));
    const double area = length(n);
    if (!(area > 0)) {
        return;
    }
    n = {n[0] / area, n[1] / area, n[2] / area};
    for (std::size_t i = 0; i < 3; ++i) {
        const std::uint32_t a = t[i];
        const std::uint32_t b = t[(i + 1) % 3];
        quadrics_[a].add_plane(n, at(a), area);
        const Double3 edge = minus(at(b), at(a));
        if (mesh_.is_border(a, b) && square(edge) > 0) {
            const Double3 side = cross(edge, n);
            const double size = length(side);
            const Double3 upright{side[0] / size, side[1] / size, side[2] / size};
            quadrics_[a].add_plane(upright, at(a), kBorderWeight * square(edge));
            quadrics_[b].add_plane(upright, at(a), kBorderWeight * square(edge));
        }
    }
}

float CollapseOrder::square_error(std::uint32_t from, std::uint32_t to) const {
    return static_cast<float>(quadrics_[from].mean(at(to)));
}

void CollapseOrder::push(std::uint32_t from, std::uint32_t to) {
    const float error = square_error(from, to);
    if (error <= most_) {
        queue_.push({error, from, to, version_[from], false});
    }
}

/// The edge from `from` that comes next after one of this error, to this vertex.
void CollapseOrder::push_next(std::uint32_t from, float after, std::uint32_t after_to) {
    mesh_.neighbours_of(from, near_);
    Collapse best{most_, from, kNoTarget, version_[from], true};
    for (const std::uint32_t to : near_) {
        const float error = square_error(from, to);
        if ((error > after || (error == after && to > after_to)) &&
            (error < best.square_error || (error == best.square_error && to < best.to))) {
            best.square_error = error;
            best.to = to;
        }
    }
    if (best.to != kNoTarget) {
        queue_.push(best);
    }
}

void CollapseOrder::add(std::uint32_t v) {
    push_next(v, -1, 0);
}

std::optional<Collapse> CollapseOrder::next() {
    while (!queue_.empty()) {
        const Collapse next = queue_.top();
        queue_.pop();
        if (next.version() == version_[next.from]) {
            if (next.has_others()) {
                push_next(next.from, next.square_error, next.to);
            }
            return next;
        }
    }
    return std::nullopt;
}

void CollapseOrder::collapsed(std::uint32_t from, std::uint32_t to) {
    ++version_[from];
    quadrics_[to].add(quadrics_[from]);
    ++version_[to];
    mesh_.neighbours_of(to, near_);
    for (const std::uint32_t v : near_) {
        if (!locked_[v]) {
            push(v, to);
        }
    }
    if (!locked_[to]) {
        add(to);
    }
}

}  // namespace isonest::detail
