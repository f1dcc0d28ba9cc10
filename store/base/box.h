// Dense boxes of a lattice, disjoint sets, and a hash for numbers that come in rows.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <isonest/int3.h>

namespace isonest::detail {

/// A dense box of numbers, x fastest, whose first element has the lattice coordinates `lo`.
template <class T>
struct Box {
    Int3 lo;
    Int3 size;
    std::vector<T> data;

    Box() = default;
    Box(const Int3& first, const Int3& n)
        : lo(first), size(n), data(static_cast<std::size_t>(n.product())) {}
    [[nodiscard]] T* row(std::int64_t y, std::int64_t z) {
        return data.data() + ((z - lo.z) * size.y + (y - lo.y)) * size.x;
    }
    [[nodiscard]] const T* row(std::int64_t y, std::int64_t z) const {
        return data.data() + ((z - lo.z) * size.y + (y - lo.y)) * size.x;
    }
    [[nodiscard]] T& at(const Int3& p) { return row(p.y, p.z)[p.x - lo.x]; }
    [[nodiscard]] const T& at(const Int3& p) const { return row(p.y, p.z)[p.x - lo.x]; }
};

// Disjoint sets of the numbers from 0 on, each represented by its lowest member.
//
// Source: path halving, R. E. Tarjan and J. van Leeuwen, "Worst-case analysis of set union
// algorithms", Journal of the ACM 31 (1984).

/// `parent`: at most the member itself; a root is its own parent.
template <class Index>
Index root_of(std::span<Index> parent, Index v) {
    while (parent[v] != v) {
        parent[v] = parent[parent[v]];
        v = parent[v];
    }
    return v;
}

/// Unites the sets of `a` and `b`; returns the root.
template <class Index>
Index unite(std::span<Index> parent, Index a, Index b) {
    a = root_of(parent, a);
    b = root_of(parent, b);
    parent[std::max(a, b)] = std::min(a, b);
    return std::min(a, b);
}

// A hash for numbers that come in rows. The standard library's hash is the identity: in a table
// whose size is a power of two, two distant rows may then fall into the same slots, and each
// look-up visits thousands of them.

struct MixedHash {
    std::size_t operator()(std::uint64_t v) const {
        const std::uint64_t h = v * 0x9E3779B97F4A7C15ULL;
        return static_cast<std::size_t>(h ^ (h >> 32U));
    }
};

}  // namespace isonest::detail
