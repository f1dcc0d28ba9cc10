// A dense part of a lattice in memory.
#pragma once

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

}  // namespace isonest::detail
