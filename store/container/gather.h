// Collects a box of a level's values from the chunks that hold it.
#pragma once

#include <algorithm>
#include <cstring>
#include <vector>

#include "store/base/box.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

/// Fills `box` (lattice coordinates of the array's level) with component 0 of a one-component
/// array; coordinates outside the lattice get the value of the nearest node. chunk_at(c) returns
/// the nodes of chunk c, of which those in the box are looked at; their stride along x is 1.
/// REQUIRES: the array's elements are of type T, and the box is not empty.
template <class T, class ChunkAt>
void gather_from(const ChunkAt& chunk_at, const ArrayInfo& array, Box<T>& box) {
    const Int3 last = array.nodes - Int3{1, 1, 1};
    const Int3 from = min(max(box.lo, {0, 0, 0}), last);
    const Int3 to = max(min(box.lo + box.size - Int3{1, 1, 1}, last), {0, 0, 0});
    const Int3 c0 = array.chunk_of(from);
    const Int3 c1 = array.chunk_of(to);
    // A box that lies wholly outside is filled from the nearest nodes, `from` .. `to`, below.
    const auto place = [&](std::int64_t p, int axis) {
        return std::clamp(p, box.lo[axis], box.lo[axis] + box.size[axis] - 1);
    };
    for (std::int64_t cz = c0.z; cz <= c1.z; ++cz) {
        for (std::int64_t cy = c0.y; cy <= c1.y; ++cy) {
            for (std::int64_t cx = c0.x; cx <= c1.x; ++cx) {
                const ChunkNodes chunk = chunk_at(Int3{cx, cy, cz});
                const T* const data = reinterpret_cast<const T*>(chunk.data.get());
                const Int3 base = array.first_node({cx, cy, cz});
                const Int3 lo = max(base, from);
                const Int3 hi = min(base + array.chunk - Int3{1, 1, 1}, to);
                for (std::int64_t z = lo.z; z <= hi.z; ++z) {
                    for (std::int64_t y = lo.y; y <= hi.y; ++y) {
                        std::copy_n(
                            data + (lo.x - base.x) + (y - base.y) * chunk.stride.y +
                                (z - base.z) * chunk.stride.z,
                            hi.x - lo.x + 1,
                            box.row(place(y, 1), place(z, 2)) + (place(lo.x, 0) - box.lo.x));
                    }
                }
            }
        }
    }
    // Repeat the border outward: along x in the rows that are there, then whole rows, then planes.
    const Int3 first{place(from.x, 0), place(from.y, 1), place(from.z, 2)};
    const Int3 end{place(to.x, 0), place(to.y, 1), place(to.z, 2)};
    for (std::int64_t z = first.z; z <= end.z; ++z) {
        for (std::int64_t y = first.y; y <= end.y; ++y) {
            T* const row = box.row(y, z);
            std::fill(row, row + (first.x - box.lo.x), row[first.x - box.lo.x]);
            std::fill(row + (end.x - box.lo.x) + 1, row + box.size.x, row[end.x - box.lo.x]);
        }
        for (std::int64_t y = box.lo.y; y < box.lo.y + box.size.y; ++y) {
            if (y < first.y || y > end.y) {
                std::copy_n(box.row(std::clamp(y, first.y, end.y), z), box.size.x, box.row(y, z));
            }
        }
    }
    for (std::int64_t z = box.lo.z; z < box.lo.z + box.size.z; ++z) {
        if (z < first.z || z > end.z) {
            std::copy_n(box.row(box.lo.y, std::clamp(z, first.z, end.z)), box.size.x * box.size.y,
                        box.row(box.lo.y, z));
        }
    }
}

/// The same, through a cache.
template <class T>
void gather_values(ChunkCache& cache, const ArrayInfo& array, Box<T>& box) {
    const Int3 stride{1, array.chunk.x, array.chunk.x * array.chunk.y};
    gather_from(
        [&](const Int3& chunk) {
            return ChunkNodes{cache.get(array, chunk), stride};
        },
        array, box);
}

/// `count` components from `first` on of the `size` nodes from `lo` on, [z][y][x][component].
/// REQUIRES: the nodes lie in the array's lattice; its elements are of type T.
template <class T>
std::vector<T> gather_components(ChunkCache& cache, const ArrayInfo& array, const Int3& lo,
                                 const Int3& size, int first, int count) {
    std::vector<T> out(static_cast<std::size_t>(size.product() * count));
    const Int3 c0 = array.chunk_of(lo);
    const Int3 chunks = array.chunk_of(lo + size - Int3{1, 1, 1}) - c0 + Int3{1, 1, 1};
    for (std::int64_t c = 0; c < chunks.product(); ++c) {
        const Int3 which = c0 + chunks.unlinear(c);
        const DecodedChunk chunk = cache.get(array, which);
        const T* const data = reinterpret_cast<const T*>(chunk.get());
        const Int3 base = array.first_node(which);
        const Int3 from = max(base, lo);
        const Int3 n = min(base + array.chunk, lo + size) - from;
        for (std::int64_t i = 0; i < n.product(); ++i) {
            const Int3 p = from + n.unlinear(i);
            std::copy_n(data + array.chunk.linear(p - base) * array.components + first, count,
                        out.begin() + size.linear(p - lo) * count);
        }
    }
    return out;
}

}  // namespace isonest::detail
