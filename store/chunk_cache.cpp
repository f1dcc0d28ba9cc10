#include "store/chunk_cache.h"

namespace isonest {

void ChunkCache::evict(std::uint64_t incoming) {
    for (auto it = order_.begin(); it != order_.end() && bytes_ + incoming > budget_;) {
        const auto found = entries_.find(*it);
        // A chunk that somebody holds would stay in memory anyway.
        if (found->second.chunk == nullptr || found->second.chunk.use_count() > 1) {
            ++it;
            continue;
        }
        bytes_ -= found->second.bytes;
        entries_.erase(found);
        it = order_.erase(it);
    }
}

DecodedChunk ChunkCache::get(const ArrayInfo& array, const Int3& chunk) {
    const std::uint64_t key = array.row_of(chunk);
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
    const std::uint64_t bytes = array.chunk_bytes();
    evict(bytes);
    Entry& entry = entries_[key];
    entry.use = order_.insert(order_.end(), key);
    entry.bytes = bytes;
    bytes_ += bytes;
    peak_ = std::max(peak_, bytes_);
    lock.unlock();

    std::shared_ptr<std::byte[]> raw;
    try {
        raw = std::make_unique_for_overwrite<std::byte[]>(bytes);
        source_.decode(array, chunk, {raw.get(), bytes});
    } catch (...) {
        lock.lock();
        const auto failed = entries_.find(key);
        bytes_ -= failed->second.bytes;
        order_.erase(failed->second.use);
        entries_.erase(failed);
        decoded_.notify_all();
        throw;
    }
    lock.lock();
    entries_.find(key)->second.chunk = raw;
    decoded_.notify_all();
    return raw;
}

std::uint64_t ChunkCache::peak_bytes() const {
    const std::lock_guard lock(mutex_);
    return peak_;
}

}  // namespace isonest
