#include "store/container/chunk_cache.h"

#include <array>
#include <bit>
#include <cstring>
#include <utility>
#include <vector>

namespace isonest::detail {
namespace {

std::uint64_t key_of(const ArrayInfo& array, const Int3& chunk) {
    return 2 * array.row_of(chunk);
}

std::size_t element_bytes(const ArrayInfo& array) {
    return array.codec.element_size * static_cast<std::size_t>(array.components);
}

/// Storage of the sides of a chunk: the planes of each axis, x first, those at its low end first;
/// within a plane the smaller axis is fastest.
struct SideAxis {
    std::int64_t low = 0;    ///< planes
    std::int64_t high = 0;   ///< planes
    std::int64_t first = 0;  ///< element of the first plane
    std::int64_t plane = 0;  ///< elements
    Int3 stride;             ///< within a plane

    [[nodiscard]] std::int64_t planes() const { return low + high; }
    /// Number of the plane at coordinate p of `size`; -1 if it is not part of the sides.
    [[nodiscard]] std::int64_t plane_at(std::int64_t p, std::int64_t size) const {
        return p < low ? p : p >= size - high ? low + p - (size - high) : -1;
    }
};

std::array<SideAxis, 3> side_axes(const Int3& chunk, const ChunkSides& sides) {
    std::array<SideAxis, 3> axes{SideAxis{0, 0, 0, chunk.y * chunk.z, {0, 1, chunk.y}},
                                 SideAxis{0, 0, 0, chunk.x * chunk.z, {1, 0, chunk.x}},
                                 SideAxis{0, 0, 0, chunk.x * chunk.y, {1, chunk.x, 0}}};
    std::int64_t first = 0;
    for (int axis = 0; axis < 3; ++axis) {
        SideAxis& a = axes[static_cast<std::size_t>(axis)];
        a.low = std::min(sides.low, chunk[axis]);
        a.high = std::min(sides.high, chunk[axis] - a.low);
        a.first = first;
        first += a.planes() * a.plane;
    }
    return axes;
}

std::uint64_t side_bytes(const ArrayInfo& array, const ChunkSides& sides) {
    const std::array<SideAxis, 3> axes = side_axes(array.chunk, sides);
    const SideAxis& last = axes[2];
    return static_cast<std::uint64_t>(last.first + last.planes() * last.plane) *
           element_bytes(array);
}

/// Position of node p within the sides, in elements; -1 if it is in none of them.
std::int64_t place_in_sides(const Int3& chunk, const ChunkSides& sides, const Int3& p) {
    const std::array<SideAxis, 3> axes = side_axes(chunk, sides);
    for (int axis = 0; axis < 3; ++axis) {
        const SideAxis& a = axes[static_cast<std::size_t>(axis)];
        if (const std::int64_t plane = a.plane_at(p[axis], chunk[axis]); plane >= 0) {
            return a.first + plane * a.plane + p.x * a.stride.x + p.y * a.stride.y +
                   p.z * a.stride.z;
        }
    }
    return -1;
}

/// Copies one plane of a chunk.
void copy_plane(const Int3& chunk, int axis, std::int64_t at, std::size_t element,
                const std::byte* from, std::byte* to) {
    const auto x = static_cast<std::size_t>(chunk.x);
    const auto y = static_cast<std::size_t>(chunk.y);
    const auto z = static_cast<std::size_t>(chunk.z);
    const auto p = static_cast<std::size_t>(at);
    const std::size_t row = x * element;
    if (axis == 0) {
        for (std::size_t i = 0; i < y * z; ++i) {
            std::memcpy(to + i * element, from + i * row + p * element, element);
        }
    } else if (axis == 1) {
        for (std::size_t i = 0; i < z; ++i) {
            std::memcpy(to + i * row, from + (i * y + p) * row, row);
        }
    } else {
        std::memcpy(to, from + p * y * row, y * row);
    }
}

}  // namespace

DecodedChunk ChunkCache::copy_sides(const ArrayInfo& array, const std::byte* whole) const {
    const std::size_t element = element_bytes(array);
    std::shared_ptr<std::byte[]> out =
        std::make_unique_for_overwrite<std::byte[]>(side_bytes(array, sides_));
    const std::array<SideAxis, 3> axes = side_axes(array.chunk, sides_);
    for (int axis = 0; axis < 3; ++axis) {
        const SideAxis& a = axes[static_cast<std::size_t>(axis)];
        for (std::int64_t i = 0; i < a.planes(); ++i) {
            const std::int64_t at = i < a.low ? i : array.chunk[axis] - a.planes() + i;
            copy_plane(array.chunk, axis, at, element, whole,
                       out.get() + static_cast<std::size_t>(a.first + i * a.plane) * element);
        }
    }
    return out;
}

void ChunkCache::evict(std::uint64_t incoming) {
    for (auto it = order_.begin(); it != order_.end() && bytes_ + incoming > budget_;) {
        const auto found = entries_.find(*it++);
        // A chunk held by somebody else would stay in memory anyway.
        if (found->second.chunk != nullptr && found->second.chunk.use_count() == 1) {
            erase(found);
        }
    }
}

ChunkCache::Entry& ChunkCache::insert(std::uint64_t key, std::uint64_t bytes) {
    Entry& entry = entries_[key];
    entry.use = order_.insert(order_.end(), key);
    entry.bytes = bytes;
    bytes_ += bytes;
    peak_ = std::max(peak_, bytes_);
    return entry;
}

void ChunkCache::erase(Entries::iterator entry) {
    bytes_ -= entry->second.bytes;
    order_.erase(entry->second.use);
    entries_.erase(entry);
}

/// REQUIRES: this thread has made a null entry for the chunk; `lock` is held, and is held again on
/// return. Throws what ChunkSource::decode throws; the entry is then removed.
DecodedChunk ChunkCache::decode(const ArrayInfo& array, const Int3& chunk,
                                std::unique_lock<std::mutex>& lock) {
    lock.unlock();
    const auto bytes = static_cast<std::size_t>(array.chunk_bytes());
    std::shared_ptr<std::byte[]> raw;
    std::uint64_t stored = 0;
    try {
        raw = std::make_unique_for_overwrite<std::byte[]>(bytes);
        source_.decode(array, chunk, {raw.get(), bytes});
        stored = source_.row(array, chunk).bytes;
    } catch (...) {
        lock.lock();
        erase(entries_.find(key_of(array, chunk)));
        decoded_.notify_all();
        throw;
    }
    lock.lock();
    ++chunks_read_;
    bytes_read_ += stored;
    return raw;
}

void ChunkCache::prefetch(std::span<const NeededChunk> needed) {
    std::vector<WantedChunk> wanted;
    {
        const std::lock_guard lock(mutex_);
        for (const NeededChunk& need : needed) {
            const std::uint64_t key = key_of(*need.array, need.chunk);
            auto found = entries_.find(key);
            if (found == entries_.end() && !need.whole) {
                found = entries_.find(key + 1);
            }
            if (found == entries_.end()) {
                wanted.push_back({need.array, need.chunk});
            } else {
                order_.splice(order_.end(), order_, found->second.use);
            }
        }
    }
    if (!wanted.empty()) {
        source_.prefetch_all(wanted);
    }
}

DecodedChunk ChunkCache::peek(const ArrayInfo& array, const Int3& chunk) const {
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(key_of(array, chunk));
    return found != entries_.end() ? found->second.chunk : nullptr;
}

DecodedChunk ChunkCache::get(const ArrayInfo& array, const Int3& chunk) {
    const std::uint64_t key = key_of(array, chunk);
    std::unique_lock lock(mutex_);
    while (true) {
        const auto found = entries_.find(key);
        if (found == entries_.end()) {
            break;
        }
        if (found->second.chunk != nullptr) {
            order_.splice(order_.end(), order_, found->second.use);
            return found->second.chunk;
        }
        decoded_.wait(lock);
    }
    const std::uint64_t bytes = array.chunk_bytes() + kEntryOverhead;
    evict(bytes);
    insert(key, bytes);
    const DecodedChunk raw = decode(array, chunk, lock);
    entries_.find(key)->second.chunk = raw;
    decoded_.notify_all();
    return raw;
}

ChunkNodes ChunkCache::nodes(const ArrayInfo& array, const Int3& chunk, unsigned low) {
    const ChunkPart found =
        part(array, chunk,
             {(low & 1U) != 0 ? 0 : array.chunk.x / 2, (low & 2U) != 0 ? 0 : array.chunk.y / 2,
              (low & 4U) != 0 ? 0 : array.chunk.z / 2});
    if (found.is_whole) {
        return {found.data, {1, array.chunk.x, array.chunk.x * array.chunk.y}};
    }
    const SideAxis side =
        side_axes(array.chunk, sides_)[static_cast<std::size_t>(std::countr_zero(low))];
    return {{found.data,
             found.data.get() + static_cast<std::size_t>(side.first) * element_bytes(array)},
            side.stride};
}

const std::byte* ChunkCache::find(const ArrayInfo& array, const ChunkPart& part,
                                  const Int3& p) const {
    const std::int64_t at =
        part.is_whole ? array.chunk.linear(p) : place_in_sides(array.chunk, sides_, p);
    return at < 0 ? nullptr : part.data.get() + static_cast<std::size_t>(at) * element_bytes(array);
}

ChunkPart ChunkCache::part(const ArrayInfo& array, const Int3& chunk, const Int3& p) {
    if (place_in_sides(array.chunk, sides_, p) < 0) {
        return {get(array, chunk), true};
    }
    const std::uint64_t key = key_of(array, chunk);
    std::unique_lock lock(mutex_);
    while (true) {
        if (const auto found = entries_.find(key); found != entries_.end()) {
            if (found->second.chunk != nullptr) {
                order_.splice(order_.end(), order_, found->second.use);
                return {found->second.chunk, true};
            }
            decoded_.wait(lock);
            continue;
        }
        const auto kept = entries_.find(key + 1);
        if (kept == entries_.end()) {
            break;
        }
        order_.splice(order_.end(), order_, kept->second.use);
        return {kept->second.chunk, false};
    }
    const std::uint64_t bytes = array.chunk_bytes() + kEntryOverhead;
    insert(key, bytes);
    const DecodedChunk raw = decode(array, chunk, lock);
    // The inside of a chunk that nobody asked for must not displace chunks that others need soon.
    const std::uint64_t sides_size = side_bytes(array, sides_) + kEntryOverhead;
    if (bytes_ <= budget_ || 2 * sides_size > bytes) {
        evict(0);
        entries_.find(key)->second.chunk = raw;
        decoded_.notify_all();
        return {raw, true};
    }
    lock.unlock();
    const DecodedChunk sides = copy_sides(array, raw.get());
    lock.lock();
    erase(entries_.find(key));
    evict(sides_size);
    insert(key + 1, sides_size).chunk = sides;
    decoded_.notify_all();
    return {sides, false};
}

void ChunkCache::keep_sides(const ArrayInfo& array, const Int3& chunk) {
    const std::uint64_t key = key_of(array, chunk);
    const std::uint64_t bytes = side_bytes(array, sides_) + kEntryOverhead;
    if (2 * bytes > array.chunk_bytes()) {
        return;
    }
    DecodedChunk whole;
    {
        const std::lock_guard lock(mutex_);
        const auto found = entries_.find(key);
        if (found == entries_.end() || found->second.chunk == nullptr) {
            return;
        }
        whole = found->second.chunk;
    }
    const DecodedChunk sides = copy_sides(array, whole.get());

    // `whole` is released last, after the lock, because freeing takes time.
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    constexpr long kOursAndItsOwn = 2;
    if (found == entries_.end() || found->second.chunk != whole ||
        whole.use_count() > kOursAndItsOwn) {
        return;
    }
    erase(found);
    if (!entries_.contains(key + 1)) {
        evict(bytes);
        insert(key + 1, bytes).chunk = sides;
    }
}

std::uint64_t ChunkCache::peak_bytes() const {
    const std::lock_guard lock(mutex_);
    return peak_;
}

std::uint64_t ChunkCache::chunks_read() const {
    const std::lock_guard lock(mutex_);
    return chunks_read_;
}

std::uint64_t ChunkCache::bytes_read() const {
    const std::lock_guard lock(mutex_);
    return bytes_read_;
}

}  // namespace isonest::detail
