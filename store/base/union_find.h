// Disjoint sets of the numbers from 0 on, each known by its lowest member.
//
// Source: path halving, R. E. Tarjan and J. van Leeuwen, "Worst-case analysis of set union
// algorithms", Journal of the ACM 31 (1984).
#pragma once

#include <algorithm>
#include <span>

namespace isonest::detail {

/// `parent`: no member's is larger than itself; that of a root is itself.
template <class Index>
Index root_of(std::span<Index> parent, Index v) {
    while (parent[v] != v) {
        parent[v] = parent[parent[v]];
        v = parent[v];
    }
    return v;
}

/// Makes one set of those of `a` and `b`; its root.
template <class Index>
Index unite(std::span<Index> parent, Index a, Index b) {
    a = root_of(parent, a);
    b = root_of(parent, b);
    parent[std::max(a, b)] = std::min(a, b);
    return std::min(a, b);
}

}  // namespace isonest::detail
