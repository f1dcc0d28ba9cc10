#include "query/surface_nets/label_planes.h"

#include <algorithm>
#include <optional>

#include <isonest/value_type.h>

#include "query/labels/label_of_value.h"

namespace isonest::detail {
namespace {

template <class T>
std::int64_t label_or_missing(T value, bool bits, const std::string& name) {
    const std::optional<std::int64_t> label = label_of(value, bits);
    if (!label) {
        require_missing(static_cast<double>(value), name);
    }
    return label.value_or(kMissingLabel);
}

}  // namespace

std::uint64_t LabelPlanes::held_bytes(const ArrayInfo& array, std::int64_t edge) {
    const Int3 chunks = min(ceil_div(Int3{edge, edge, 1}, array.chunk) + Int3{1, 1, 0}, array.grid);
    return static_cast<std::uint64_t>(chunks.x * chunks.y) * array.chunk_bytes();
}

void LabelPlanes::hold(const Int3& first, const Int3& last) {
    if (!held_.empty() && held_.front().chunk.z == first.z) {
        return;
    }
    held_.clear();
    for (std::int64_t y = first.y; y <= last.y; ++y) {
        for (std::int64_t x = first.x; x <= last.x; ++x) {
            const Int3 chunk{x, y, first.z};
            const ChunkRow row = cache_.source().row(array_, chunk);
            if (row.min == row.max && row.flags == 0) {
                held_.push_back({chunk, nullptr, label_or_missing(row.min, bits_, name_)});
            } else {
                held_.push_back({chunk, cache_.get(array_, chunk), 0});
            }
        }
    }
}

void LabelPlanes::copy(const Held& held, const Int3& low, const Int3& size,
                       std::span<std::int64_t> to) const {
    const Int3 base = array_.first_node(held.chunk);
    const Int3 begin = max(base, low);
    const Int3 end = min(min(base + array_.chunk, array_.nodes), low + size);
    for (std::int64_t y = begin.y; y < end.y; ++y) {
        std::int64_t* const row = to.data() + (y - low.y) * size.x + (begin.x - low.x);
        const std::int64_t count = end.x - begin.x;
        if (held.data == nullptr) {
            std::fill_n(row, count, held.all);
            continue;
        }
        dispatch(cache_.source().layout().header().type, [&](auto tag) {
            using T = typename decltype(tag)::type;
            const T* const from = reinterpret_cast<const T*>(held.data.get()) +
                                  array_.chunk.linear(Int3{begin.x, y, low.z} - base);
            std::transform(from, from + count, row,
                           [&](T value) { return label_or_missing(value, bits_, name_); });
        });
    }
}

void LabelPlanes::read(const Int3& low, const Int3& size, std::span<std::int64_t> to) {
    const Int3 begin = max(low, {0, 0, 0});
    const Int3 end = min(low + size, array_.nodes);
    if (begin != low || end != low + size) {
        std::fill(to.begin(), to.end(), kOutsideLabel);
    }
    if (low.z < 0 || low.z >= array_.nodes.z || begin.x >= end.x || begin.y >= end.y) {
        return;
    }
    hold(array_.chunk_of(begin), array_.chunk_of({end.x - 1, end.y - 1, low.z}));
    for (const Held& held : held_) {
        copy(held, low, size, to);
    }
}

}  // namespace isonest::detail
