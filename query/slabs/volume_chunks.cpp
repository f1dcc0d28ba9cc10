#include "query/slabs/volume_chunks.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#include "store/container/format.h"

namespace isonest::detail {

StoreHeader chunked_header_of(const VolumeDescription& volume, int chunk) {
    StoreHeader header = header_of(volume);
    header.chunk = chunk;
    header.fields = {};
    header.cube_ranges = false;
    return header;
}

VolumeChunks::VolumeChunks(const StoreLayout& layout, const SlabPlanes& planes, const Slab& cells)
    : layout_(layout),
      values_(layout.array(0, Field::values)),
      planes_(planes),
      layer_(cells.begin / values_.chunk.z),
      begin_(std::max<std::int64_t>(cells.begin - 1, 0)),
      end_(std::min(cells.end + 2, values_.nodes.z)) {
    dispatch(layout.header().type, [&](auto tag) { fill_rows<typename decltype(tag)::type>(); });
}

std::uint64_t VolumeChunks::heap(const StoreLayout& layout) {
    const Int3 grid = layout.array(0, Field::values).grid;
    return 3 * static_cast<std::uint64_t>(grid.x * grid.y) * sizeof(ChunkRow);
}

template <class T>
void VolumeChunks::fill_rows() {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    const Int3& n = values_.nodes;
    const Int3& k = values_.chunk;
    const Int3& grid = values_.grid;
    rows_.assign(static_cast<std::size_t>(3 * grid.x * grid.y),
                 ChunkRow{0, 0, 0, 0, kInfinity, -kInfinity});
    range_ = {kInfinity, -kInfinity};
    for (std::int64_t z = begin_; z < end_; ++z) {
        const std::int64_t layer = z / k.z;
        for (std::int64_t y = 0; y < n.y; ++y) {
            const T* const row =
                reinterpret_cast<const T*>(planes_.data) + ((z - planes_.first) * n.y + y) * n.x;
            for (std::int64_t x = 0; x < n.x; x += k.x) {
                T low = std::numeric_limits<T>::max();
                T high = std::numeric_limits<T>::lowest();
                bool missing = false;
                const std::int64_t to = std::min(x + k.x, n.x);
                for (std::int64_t i = x; i < to; ++i) {
                    if constexpr (std::is_floating_point_v<T>) {
                        const bool finite = std::isfinite(row[i]);
                        missing = missing || !finite;
                        low = finite && row[i] < low ? row[i] : low;
                        high = finite && row[i] > high ? row[i] : high;
                    } else {
                        low = std::min(low, row[i]);
                        high = std::max(high, row[i]);
                    }
                }
                ChunkRow& of = rows_[static_cast<std::size_t>(
                    ((layer - layer_ + 1) * grid.y + y / k.y) * grid.x + x / k.x)];
                of.flags |= missing ? kChunkHasMissing : 0;
                if (low <= high) {
                    of.min = std::min(of.min, static_cast<double>(low));
                    of.max = std::max(of.max, static_cast<double>(high));
                }
            }
        }
    }
    const auto plane = static_cast<std::size_t>(grid.x * grid.y);
    for (std::size_t i = plane; i < 2 * plane; ++i) {
        range_ = {std::min(range_[0], rows_[i].min), std::max(range_[1], rows_[i].max)};
        has_missing_ = has_missing_ || (rows_[i].flags & kChunkHasMissing) != 0;
    }
}

ChunkRow VolumeChunks::row(const ArrayInfo& /*array*/, const Int3& chunk) const {
    return rows_[static_cast<std::size_t>(
        ((chunk.z - layer_ + 1) * values_.grid.y + chunk.y) * values_.grid.x + chunk.x)];
}

void VolumeChunks::decode(const ArrayInfo& array, const Int3& chunk,
                          std::span<std::byte> raw) const {
    const Int3& n = array.nodes;
    const Int3& k = array.chunk;
    const std::size_t bytes = size_of(layout_.header().type);
    const Int3 low = array.first_node(chunk);
    const Int3 size = min(k, n - low);
    std::fill(raw.begin(), raw.end(), std::byte{0});
    const std::int64_t first = std::max(low.z, begin_);
    const std::int64_t end = std::min(low.z + size.z, end_);
    for (std::int64_t z = first; z < end; ++z) {
        for (std::int64_t y = 0; y < size.y; ++y) {
            const auto from =
                static_cast<std::size_t>(((z - planes_.first) * n.y + low.y + y) * n.x + low.x);
            const auto to = static_cast<std::size_t>(((z - low.z) * k.y + y) * k.x);
            std::memcpy(raw.data() + to * bytes, planes_.data + from * bytes,
                        static_cast<std::size_t>(size.x) * bytes);
        }
    }
}

}  // namespace isonest::detail
