#include "query/simplify/collapse/line_collapse.h"

#include <algorithm>
#include <numeric>

namespace isonest::detail {

SheetLines::SheetLines(std::span<const std::uint32_t> next_copy, std::vector<bool>& locked)
    : next_(next_copy) {
    if (!next_.empty()) {
        first_.resize(next_.size());
        std::iota(first_.begin(), first_.end(), 0U);
    }
    for (std::uint32_t v = 0; v < next_.size(); ++v) {
        bool stays = locked[v];
        std::uint32_t first = v;
        for (std::uint32_t w = next_[v]; w != v; w = next_[w]) {
            stays = stays || locked[w];
            first = std::min(first, w);
        }
        if (first == v && stays) {
            locked[v] = true;
            for (std::uint32_t w = next_[v]; w != v; w = next_[w]) {
                locked[w] = true;
            }
        }
        first_[v] = first;
    }
    known_ = locked;
    silent_ = locked;
    for (std::uint32_t v = 0; v < next_.size(); ++v) {
        known_[v] = known_[v] || next_[v] != v;
        silent_[v] = silent_[v] || first_[v] != v;
    }
}

/// Returns false if the line does not continue from `to` over `from` in all sheets.
bool LineCollapse::find_copies(std::uint32_t from, std::uint32_t to) {
    sheets_.clear();
    std::uint32_t beyond = CornerMesh::kNone;
    std::uint32_t copy = from;
    do {
        mesh_.ring_of(copy, ring_);
        if (ring_.is_closed || ring_.vertices.size() < 3) {
            return false;
        }
        std::uint32_t one = ring_.vertices.front();
        std::uint32_t other = ring_.vertices.back();
        if (lines_.first(one) != lines_.first(to)) {
            std::swap(one, other);
        }
        if (lines_.first(one) != lines_.first(to) ||
            (beyond != CornerMesh::kNone && lines_.first(other) != beyond)) {
            return false;
        }
        beyond = lines_.first(other);
        sheets_.push_back({copy, one, other});
        copy = lines_.next(copy);
    } while (copy != from);
    return beyond != lines_.first(to);
}

/// Whether there is an edge between copies of the two; `a` must have all its edges in the patch.
bool LineCollapse::have_edge(std::uint32_t a, std::uint32_t b) const {
    std::uint32_t copy = a;
    do {
        mesh_.ring_of(copy, ring_);
        if (std::any_of(ring_.vertices.begin(), ring_.vertices.end(),
                        [&](std::uint32_t v) { return lines_.first(v) == lines_.first(b); })) {
            return true;
        }
        copy = lines_.is_line(copy) ? lines_.next(copy) : a;
    } while (copy != a);
    return false;
}

/// Returns false if the vertex is not between its neighbours.
bool LineCollapse::find_slide() {
    constexpr double kMinPart = 0.05;  // relative to the way from one to the other
    const Double3 from = point_at(positions_[sheets_[0].from]);
    const Double3 to = point_at(positions_[sheets_[0].to]);
    const Double3 beyond = point_at(positions_[sheets_[0].beyond]);
    const Double3 line = minus(to, beyond);
    const double part = dot(minus(from, beyond), line) / square(line);
    if (!(part > kMinPart && part < 1 - kMinPart)) {
        return false;
    }
    for (std::size_t a = 0; a < 3; ++a) {
        slide_[a] = beyond[a] + part * line[a] - from[a];
    }
    return true;
}

bool LineCollapse::passes_node(std::uint32_t from) const {
    const Double3 was = point_at(positions_[from]);
    return nodes_ != nullptr &&
           nodes_->any(collapse_.star(),
                       {was[0] + slide_[0], was[1] + slide_[1], was[2] + slide_[2]}, slide_);
}

double LineCollapse::look_in_sheet(const Copies& copies, double limit, float least) {
    if (!collapse_.look(copies.from, copies.to, copies.beyond)) {
        return kRefused;
    }
    // Another sheet may have the remaining triangle.
    if (collapse_.star().corners == 3 && lines_.known()[collapse_.ring().vertices[1]]) {
        return kRefused;
    }
    collapse_.slide(slide_);
    if (!collapse_.has_no_new_needle() || !collapse_.has_no_new_fold(least) ||
        !mapping_.look(collapse_, slide_) || passes_node(copies.from)) {
        return kRefused;
    }
    double largest = 0;
    for (std::size_t j = 1; j + 1 < collapse_.star().corners; ++j) {
        largest = std::max(largest, mapping_.map(j));
        if (!(largest <= limit)) {
            return kRefused;
        }
    }
    return largest;
}

double LineCollapse::look(std::uint32_t from, std::uint32_t to, double limit, float least) {
    if (!lines_.is_line(to) || !find_copies(from, to)) {
        return kRefused;
    }
    const std::uint32_t beyond = sheets_[0].beyond;
    // A vertex that is not locked has all its edges in the patch.
    const bool is_free = !locked_[to]       ? !have_edge(to, beyond)
                         : !locked_[beyond] ? !have_edge(beyond, to)
                                            : false;
    if (!is_free || !find_slide() || !(length(slide_) <= limit)) {
        return kRefused;
    }
    limit_ = limit;
    min_ = least;
    double largest = 0;
    for (const Copies& copies : sheets_) {
        largest = std::max(largest, look_in_sheet(copies, limit, least));
        if (largest == kRefused) {
            break;
        }
    }
    return largest;
}

std::uint32_t LineCollapse::take(EdgeQueue& queue) {
    std::uint32_t fewer = 0;
    // The first copy comes last: the queue's caller uses its ring.
    for (std::size_t i = sheets_.size(); i-- > 0;) {
        static_cast<void>(look_in_sheet(sheets_[i], limit_, min_));
        fewer += collapse_.fewer();
        mapping_.take(collapse_);
        collapse_.take();
        if (i > 0) {
            queue.collapsed(sheets_[i].from, collapse_.ring(), lines_.silent());
        }
    }
    return fewer;
}

}  // namespace isonest::detail
