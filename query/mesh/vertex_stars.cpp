#include "query/mesh/vertex_stars.h"

#include <algorithm>
#include <iterator>

namespace isonest::detail {

VertexStars::VertexStars(std::uint64_t vertices, std::uint64_t triangles,
                         const ScratchFolder& folder)
    : first_file_(folder), next_file_(folder) {
    first_file_.map(vertices * sizeof(std::uint64_t));
    next_file_.map(3 * triangles * sizeof(std::uint64_t));
    first_ = first_file_.as<std::uint64_t>();
    next_ = next_file_.as<std::uint64_t>();
}

void VertexStars::remove(std::uint64_t corner, std::uint64_t v) {
    if (!is_marked(v)) {
        return;
    }
    std::uint64_t* link = &first_[v];
    while (*link != corner + kFirst) {
        link = &next_[*link - kFirst];
    }
    *link = next_[corner];
}

void VertexStars::corners_of(std::uint64_t v, std::vector<std::uint64_t>& corners) const {
    corners.clear();
    for (std::uint64_t link = first_[v]; link != kEnd; link = next_[link - kFirst]) {
        corners.push_back(link - kFirst);
    }
}

namespace {

using Edge = std::array<std::uint64_t, 2>;

LinkEdges::const_iterator from(const LinkEdges& link, std::uint64_t v) {
    return std::lower_bound(link.begin(), link.end(), Edge{v, 0});
}

bool has(const LinkEdges& link, const Edge& edge) {
    return std::binary_search(link.begin(), link.end(), edge);
}

}  // namespace

bool close_link(LinkEdges& link) {
    std::sort(link.begin(), link.end());
    std::vector<std::uint64_t> ends(link.size());
    std::transform(link.begin(), link.end(), ends.begin(), [](const Edge& e) { return e[1]; });
    std::sort(ends.begin(), ends.end());
    std::vector<std::uint64_t> starts(link.size());
    std::transform(link.begin(), link.end(), starts.begin(), [](const Edge& e) { return e[0]; });
    if (std::adjacent_find(starts.begin(), starts.end()) != starts.end() ||
        std::adjacent_find(ends.begin(), ends.end()) != ends.end()) {
        return false;
    }
    std::vector<std::uint64_t> first;
    std::set_difference(starts.begin(), starts.end(), ends.begin(), ends.end(),
                        std::back_inserter(first));
    if (first.size() > 1) {
        return false;
    }
    if (!first.empty()) {
        std::vector<std::uint64_t> last;
        std::set_difference(ends.begin(), ends.end(), starts.begin(), starts.end(),
                            std::back_inserter(last));
        link.push_back({last.front(), kBeyondBorder});
        link.push_back({kBeyondBorder, first.front()});
        std::sort(link.begin(), link.end());
    }
    if (link.size() < 3) {
        return false;
    }
    // Every vertex starts one edge and ends one: following the edges from any vertex leads back to
    // it.
    std::size_t steps = 0;
    std::uint64_t at = link.front()[0];
    do {
        at = (*from(link, at))[1];
        ++steps;
    } while (at != link.front()[0]);
    return steps == link.size();
}

bool may_collapse(const LinkEdges& a, const LinkEdges& b) {
    std::size_t common = 0;
    for (const Edge& e : a) {
        const auto other = from(b, e[0]);
        common += other != b.end() && (*other)[0] == e[0] ? 1 : 0;
        if (has(b, e) || has(b, {e[1], e[0]})) {
            return false;
        }
    }
    // The two vertices opposite the edge itself.
    return common == 2;
}

}  // namespace isonest::detail
