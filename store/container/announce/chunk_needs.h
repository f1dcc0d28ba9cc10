// Which chunks a piece of work needs, each once, before any of them is decoded.
#pragma once

#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "store/container/chunk_cache.h"

namespace isonest::detail {

/// Not thread-safe.
class ChunkNeeds {
  public:
    /// Chunks outside the array's grid are left out. `whole`: not only nodes in its sides.
    void add(const ArrayInfo& array, const Int3& chunk, bool whole = true) {
        if (!array.has_chunk(chunk)) {
            return;
        }
        const auto [found, is_new] = places_.try_emplace(array.row_of(chunk), chunks_.size());
        if (is_new) {
            chunks_.push_back({&array, chunk, whole});
            bytes_ += bytes_of(array);
        } else if (whole) {
            chunks_[found->second].whole = true;
        }
    }
    void add(const ChunkNeeds& others) {
        for (const NeededChunk& c : others.chunks_) {
            add(*c.array, c.chunk, c.whole);
        }
    }
    [[nodiscard]] bool contains(const ArrayInfo& array, const Int3& chunk) const {
        return places_.contains(array.row_of(chunk));
    }
    /// What `others` would add to bytes().
    [[nodiscard]] std::uint64_t more_bytes(const ChunkNeeds& others) const {
        std::uint64_t more = 0;
        for (const NeededChunk& c : others.chunks_) {
            more += places_.contains(c.array->row_of(c.chunk)) ? 0 : bytes_of(*c.array);
        }
        return more;
    }
    /// In the order in which they were added.
    [[nodiscard]] std::span<const NeededChunk> chunks() const { return chunks_; }
    /// Of all of them, decoded and in a cache.
    [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
    /// Heap that this takes, about.
    [[nodiscard]] std::uint64_t heap() const { return kHeapOfOne * chunks_.size(); }

  private:
    static constexpr std::uint64_t kHeapOfOne = 128;
    static std::uint64_t bytes_of(const ArrayInfo& array) {
        return array.chunk_bytes() + ChunkCache::kEntryOverhead;
    }

    std::vector<NeededChunk> chunks_;
    std::unordered_map<std::uint64_t, std::size_t> places_;  ///< by row of the chunk table
    std::uint64_t bytes_ = 0;
};

}  // namespace isonest::detail
