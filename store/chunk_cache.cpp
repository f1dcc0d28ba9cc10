#include "store/chunk_cache.h"

#include <array>
#include <bit>
#include <cstring>
#include <utility>

namespace isonest {
namespace {

std::uint64_t key_of(const ArrayInfo& array, const Int3& chunk) {
    return 2 * array.row_of(chunk);
}

std::size_t element_bytes(const ArrayInfo& array) {
    return array.codec.element_size * static_cast<std::size_t>(array.components);
}

/// Where a side lies among the three low sides of a chunk, x = 0 first, then y = 0 and z = 0; each
/// is a plane, the smaller axis fastest.
struct Side {
    std::int64_t first = 0;
    Int3 stride;
};

std::array<Side, 3> sides_of(const Int3& chunk) {
    const std::int64_t x_size = chunk.y * chunk.z;
    const std::int64_t y_size = chunk.x * chunk.z;
    return {Side{0, {0, 1, chunk.y}}, Side{x_size, {1, 0, chunk.x}},
            Side{x_size + y_size, {1, chunk.x, 0}}};
}

/// What an entry takes beside its nodes.
constexpr std::uint64_t kEntryOverhead = 192;

void copy_low_sides(const Int3& chunk, std::size_t element, const std::byte* from, std::byte* to) {
    const auto x = static_cast<std::size_t>(chunk.x);
    const auto y = static_cast<std::size_t>(chunk.y);
    const auto z = static_cast<std::size_t>(chunk.z);
    const std::size_t row = x * element;
    for (std::size_t i = 0; i < y * z; ++i) {
        std::memcpy(to + i * element, from + i * row, element);
    }
    to += y * z * element;
    for (std::size_t i = 0; i < z; ++i) {
        std::memcpy(to + i * row, from + i * y * row, row);
    }
    std::memcpy(to + z * row, from, y * row);
}

}  // namespace

void ChunkCache::evict(std::uint64_t incoming) {
    for (auto it = order_.begin(); it != order_.end() && bytes_ + incoming > budget_;) {
        const auto found = entries_.find(*it++);
        // A chunk that somebody holds would stay in memory anyway.
        if (found->second.chunk != nullptr && found->second.chunk.use_count() == 1) {
            erase(found);
        }
    }
}

ChunkCache::Entry& ChunkCache::insert(std::uint64_t key, std::uint64_t bytes) {
    bytes += kEntryOverhead;
    evict(bytes);
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

DecodedChunk ChunkCache::get(const ArrayInfo& array, const Int3& chunk) {
    return nodes(array, chunk, 0).data;
}

ChunkNodes ChunkCache::nodes(const ArrayInfo& array, const Int3& chunk, unsigned low) {
    const std::uint64_t key = key_of(array, chunk);
    const Int3 whole{1, array.chunk.x, array.chunk.x * array.chunk.y};
    std::unique_lock lock(mutex_);
    while (true) {
        if (const auto found = entries_.find(key); found != entries_.end()) {
            if (found->second.chunk != nullptr) {
                order_.splice(order_.end(), order_, found->second.use);
                return {found->second.chunk, whole};
            }
            decoded_.wait(lock);
            continue;
        }
        const auto kept = entries_.find(key + 1);
        if (low == 0 || kept == entries_.end()) {
            break;
        }
        order_.splice(order_.end(), order_, kept->second.use);
        const DecodedChunk& sides = kept->second.chunk;
        const Side side = sides_of(array.chunk)[static_cast<std::size_t>(std::countr_zero(low))];
        return {{sides, sides.get() + static_cast<std::size_t>(side.first) * element_bytes(array)},
                side.stride};
    }
    const std::uint64_t bytes = array.chunk_bytes();
    insert(key, bytes);
    lock.unlock();

    std::shared_ptr<std::byte[]> raw;
    try {
        raw = std::make_unique_for_overwrite<std::byte[]>(bytes);
        source_.decode(array, chunk, {raw.get(), bytes});
    } catch (...) {
        lock.lock();
        erase(entries_.find(key));
        decoded_.notify_all();
        throw;
    }
    lock.lock();
    entries_.find(key)->second.chunk = raw;
    decoded_.notify_all();
    return {raw, whole};
}

void ChunkCache::keep_low_sides(const ArrayInfo& array, const Int3& chunk) {
    const std::uint64_t key = key_of(array, chunk);
    DecodedChunk whole;
    {
        const std::lock_guard lock(mutex_);
        const auto found = entries_.find(key);
        if (found == entries_.end() || found->second.chunk == nullptr) {
            return;
        }
        whole = found->second.chunk;
    }
    const Int3& c = array.chunk;
    const std::size_t element = element_bytes(array);
    const std::size_t bytes = static_cast<std::size_t>(c.y * c.z + c.x * c.z + c.x * c.y) * element;
    std::shared_ptr<std::byte[]> low = std::make_unique_for_overwrite<std::byte[]>(bytes);
    copy_low_sides(c, element, whole.get(), low.get());

    // `whole` goes last, after the lock: freeing takes a while.
    const std::lock_guard lock(mutex_);
    const auto found = entries_.find(key);
    constexpr long kOursAndItsOwn = 2;
    if (found == entries_.end() || found->second.chunk != whole ||
        whole.use_count() > kOursAndItsOwn) {
        return;
    }
    erase(found);
    if (!entries_.contains(key + 1)) {
        insert(key + 1, bytes).chunk = std::move(low);
    }
}

std::uint64_t ChunkCache::peak_bytes() const {
    const std::lock_guard lock(mutex_);
    return peak_;
}

}  // namespace isonest
