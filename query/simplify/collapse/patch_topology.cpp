#include "query/simplify/collapse/patch_topology.h"

#include <algorithm>
#include <iterator>
#include <limits>
#include <numeric>

#include "store/base/union_find.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

std::uint64_t edge_key(std::uint32_t a, std::uint32_t b) {
    return std::uint64_t{std::min(a, b)} << 32U | std::max(a, b);
}

/// The edges of each vertex's link, one vertex after the other.
struct LinkEdges {
    std::vector<std::uint32_t> begin;
    std::vector<std::array<std::uint32_t, 2>> edges;

    LinkEdges(std::size_t vertices, std::span<const PatchTriangle> triangles)
        : begin(vertices + 1), edges(3 * triangles.size()) {
        for (const PatchTriangle& t : triangles) {
            for (const std::uint32_t v : t) {
                ++begin[v + 1];
            }
        }
        std::partial_sum(begin.begin(), begin.end(), begin.begin());
        std::vector<std::uint32_t> next(begin.begin(), begin.end() - 1);
        for (const PatchTriangle& t : triangles) {
            for (std::size_t i = 0; i < 3; ++i) {
                edges[next[t[i]]++] = {t[(i + 1) % 3], t[(i + 2) % 3]};
            }
        }
    }
    [[nodiscard]] std::span<const std::array<std::uint32_t, 2>> of(std::uint32_t v) const {
        return std::span(edges).subspan(begin[v], begin[v + 1] - begin[v]);
    }
};

/// Follows the edges from one to the next.
Link link_of(std::vector<std::array<std::uint32_t, 2>>& edges) {
    if (edges.empty()) {
        return {};
    }
    std::sort(edges.begin(), edges.end());
    const auto from = [&](std::uint32_t v) {
        return std::lower_bound(edges.begin(), edges.end(), std::array<std::uint32_t, 2>{v, 0});
    };
    std::vector<std::uint32_t> ends(edges.size());
    std::transform(edges.begin(), edges.end(), ends.begin(), [](const auto& e) { return e[1]; });
    std::sort(ends.begin(), ends.end());
    std::uint32_t start = kNone;
    for (std::size_t i = 0; i < edges.size(); ++i) {
        const bool twice = i > 0 && (edges[i][0] == edges[i - 1][0] || ends[i] == ends[i - 1]);
        if (twice) {
            return {LinkShape::tangled};
        }
        if (!std::binary_search(ends.begin(), ends.end(), edges[i][0])) {
            if (start != kNone) {
                return {LinkShape::tangled};
            }
            start = edges[i][0];
        }
    }
    const std::uint32_t first = start != kNone ? start : edges.front()[0];
    std::uint32_t at = first;
    for (std::size_t steps = 0; steps < edges.size(); ++steps) {
        const auto edge = from(at);
        if (edge == edges.end() || (*edge)[0] != at || (steps > 0 && at == first)) {
            return {LinkShape::tangled};
        }
        at = (*edge)[1];
    }
    if (start != kNone) {
        return {LinkShape::path, first, at};
    }
    // Two triangles with the same corners close up, too.
    return {at == first && edges.size() > 2 ? LinkShape::cycle : LinkShape::tangled};
}

}  // namespace

std::vector<Link> links_of(std::size_t vertices, std::span<const PatchTriangle> triangles) {
    const LinkEdges all(vertices, triangles);
    std::vector<Link> links(vertices);
    std::vector<std::array<std::uint32_t, 2>> edges;
    for (std::uint32_t v = 0; v < vertices; ++v) {
        const auto of = all.of(v);
        edges.assign(of.begin(), of.end());
        links[v] = link_of(edges);
    }
    return links;
}

PatchTopology::PatchTopology(const Patch& patch, std::span<const PatchTriangle> before)
    : shared_(patch.shared),
      links_(links_of(patch.positions.size(), before)),
      component_(patch.positions.size()) {
    std::iota(component_.begin(), component_.end(), 0U);
    for (const PatchTriangle& t : before) {
        for (std::size_t i = 0; i < 3; ++i) {
            unite(std::span(component_), t[i], t[(i + 1) % 3]);
            if (shared_[t[i]] && shared_[t[(i + 1) % 3]]) {
                shared_edges_.push_back(edge_key(t[i], t[(i + 1) % 3]));
            }
        }
    }
    std::copy_if(before.begin(), before.end(), std::back_inserter(shared_triangles_),
                 [&](const PatchTriangle& t) { return is_shared(t); });
    std::sort(shared_triangles_.begin(), shared_triangles_.end());
    for (std::uint32_t& c : component_) {
        c = component_[c];  // parents precede their children
    }
    std::sort(shared_edges_.begin(), shared_edges_.end());
    characteristic_ = characteristics(before);
}

bool PatchTopology::is_shared(const PatchTriangle& t) const {
    return shared_[t[0]] && shared_[t[1]] && shared_[t[2]];
}

bool PatchTopology::was_edge(std::uint32_t a, std::uint32_t b) const {
    return std::binary_search(shared_edges_.begin(), shared_edges_.end(), edge_key(a, b));
}

/// Vertices - edges + triangles of each component, by the number of its first vertex. A component
/// that came apart has a larger one.
std::vector<std::int64_t> PatchTopology::characteristics(
    std::span<const PatchTriangle> triangles) const {
    std::vector<std::int64_t> sum(component_.size());
    std::vector<bool> used(component_.size());
    std::vector<std::uint64_t> edges;
    edges.reserve(3 * triangles.size());
    for (const PatchTriangle& t : triangles) {
        ++sum[component_[t[0]]];
        for (std::size_t i = 0; i < 3; ++i) {
            edges.push_back(edge_key(t[i], t[(i + 1) % 3]));
            if (!used[t[i]]) {
                used[t[i]] = true;
                ++sum[component_[t[i]]];
            }
        }
    }
    std::sort(edges.begin(), edges.end());
    for (auto e = edges.begin(); e != edges.end(); e = std::upper_bound(e, edges.end(), *e)) {
        --sum[component_[static_cast<std::uint32_t>(*e)]];
    }
    return sum;
}

std::vector<std::uint32_t> PatchTopology::changes(std::span<const PatchTriangle> after) const {
    const std::vector<Link> links = links_of(component_.size(), after);
    std::vector<std::uint32_t> changed;
    std::vector<bool> found(component_.size());  // components with one of them
    const auto add = [&](std::uint32_t v) {
        changed.push_back(v);
        found[component_[v]] = true;
    };
    const auto same_end = [&](std::uint32_t before, std::uint32_t end) {
        return shared_[before] ? before == end : !shared_[end];
    };
    for (std::uint32_t v = 0; v < links.size(); ++v) {
        const Link& was = links_[v];
        const Link& is = links[v];
        bool same = was.shape == is.shape || (is.shape == LinkShape::none && !shared_[v]);
        if (same && is.shape == LinkShape::path && shared_[v]) {
            same = same_end(was.first, is.first) && same_end(was.last, is.last);
        }
        if (!same) {
            add(v);
        }
    }
    for (const PatchTriangle& t : after) {
        // The patch beyond could make the same one, the other way round.
        if (is_shared(t) &&
            !std::binary_search(shared_triangles_.begin(), shared_triangles_.end(), t)) {
            std::for_each(t.begin(), t.end(), add);
        }
        for (std::size_t i = 0; i < 3; ++i) {
            const std::uint32_t a = t[i];
            const std::uint32_t b = t[(i + 1) % 3];
            if (shared_[a] && shared_[b] && !was_edge(a, b)) {
                add(a);
                add(b);
            }
        }
    }
    // Where links changed, so may the characteristic: that is no more to be mended than those.
    const std::vector<std::int64_t> now = characteristics(after);
    // A torus or a tube that is gone has the characteristic 0 that it had.
    std::vector<bool> left(component_.size());
    for (const PatchTriangle& t : after) {
        left[component_[t[0]]] = true;
    }
    for (std::uint32_t v = 0; v < links.size(); ++v) {
        const std::uint32_t c = component_[v];
        const bool gone = links_[v].shape != LinkShape::none && !left[c];
        if ((now[c] != characteristic_[c] || gone) && !found[c]) {
            changed.push_back(v);
        }
    }
    return changed;
}

}  // namespace isonest::detail
