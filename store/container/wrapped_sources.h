// Chunk sources that wrap another one.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <span>

#include "store/container/chunk_source.h"

namespace isonest::detail {

/// Forwards every call to `source`, which must outlive it; derived classes override what differs.
/// Thread-safety: all methods from any thread.
class ForwardingSource : public ChunkSource {
  public:
    explicit ForwardingSource(const ChunkSource& source) : source_(source) {}
    [[nodiscard]] const StoreLayout& layout() const override { return source_.layout(); }
    [[nodiscard]] ChunkRow row(const ArrayInfo& array, const Int3& chunk) const override {
        return source_.row(array, chunk);
    }
    void decode(const ArrayInfo& array, const Int3& chunk,
                std::span<std::byte> raw) const override {
        source_.decode(array, chunk, raw);
    }
    [[nodiscard]] std::optional<CubeRange> cube_range(int level, const Int3& cube) const override {
        return source_.cube_range(level, cube);
    }
    void prefetch(const ArrayInfo& array, const Int3& chunk) const override {
        source_.prefetch(array, chunk);
    }
    [[nodiscard]] bool is_remote() const override { return source_.is_remote(); }
    void prefetch_all(std::span<const WantedChunk> chunks) const override {
        source_.prefetch_all(chunks);
    }
    void prefetch_rows(const ArrayInfo& array, const Int3& begin, const Int3& end) const override {
        source_.prefetch_rows(array, begin, end);
    }

  protected:
    [[nodiscard]] const ChunkSource& source() const { return source_; }

  private:
    const ChunkSource& source_;
};

// Records which chunks are decoded, for tests and benchmarks.

class RecordingSource : public ForwardingSource {
  public:
    using ForwardingSource::ForwardingSource;
    void decode(const ArrayInfo& array, const Int3& chunk,
                std::span<std::byte> raw) const override {
        source().decode(array, chunk, raw);
        const std::lock_guard lock(mutex_);
        ++decoded_[array.row_of(chunk)];
    }
    /// How often each chunk was decoded, by row of the chunk table. REQUIRES: no concurrent
    /// decode().
    [[nodiscard]] const std::map<std::uint64_t, int>& decoded() const { return decoded_; }

  private:
    mutable std::mutex mutex_;
    mutable std::map<std::uint64_t, int> decoded_;
};

// Simulates a chunk source behind a network, and counts round trips, for tests and benchmarks.

/// What a network would have transferred.
struct RemoteCounts {
    std::uint64_t round_trips = 0;
    std::uint64_t prefetches = 0;      ///< calls of prefetch_all() that requested a new chunk
    std::uint64_t not_prefetched = 0;  ///< decoded chunks that were not prefetched
    std::uint64_t decoded_bytes = 0;   ///< stored bytes of the decoded chunks
    std::uint64_t decoded_chunks = 0;  ///< number of decoded chunks, counting repetitions
    std::uint64_t fetched_bytes = 0;   ///< stored bytes of the fetched chunks
    std::uint64_t fetched_chunks = 0;
};

/// The model: the bytes of a chunk are available once, for the next decode(). Decoding a chunk that
/// is not available takes one round trip, in which everything that was prefetched before also
/// arrives. A chunk that was prefetched and not decoded since is not prefetched again.
class RemoteSource : public ForwardingSource {
  public:
    using ForwardingSource::ForwardingSource;
    [[nodiscard]] ChunkRow row(const ArrayInfo& array, const Int3& chunk) const override {
        {
            const std::lock_guard lock(mutex_);
            ++rows_of_level_[array.level];
        }
        return source().row(array, chunk);
    }
    void decode(const ArrayInfo& array, const Int3& chunk,
                std::span<std::byte> raw) const override {
        {
            const std::lock_guard lock(mutex_);
            arrive(array, chunk);
        }
        source().decode(array, chunk, raw);
    }
    void prefetch(const ArrayInfo& array, const Int3& chunk) const override {
        const WantedChunk wanted{&array, chunk};
        RemoteSource::prefetch_all({&wanted, 1});
    }
    [[nodiscard]] bool is_remote() const override { return true; }
    void prefetch_all(std::span<const WantedChunk> chunks) const override {
        const std::lock_guard lock(mutex_);
        bool is_new = false;
        for (const WantedChunk& wanted : chunks) {
            const ArrayInfo& array = *wanted.array;
            if (!array.has_chunk(wanted.chunk)) {
                continue;
            }
            if (under_way_.try_emplace(array.row_of(wanted.chunk), time_).second) {
                counts_.fetched_bytes += source().row(array, wanted.chunk).bytes;
                ++counts_.fetched_chunks;
                is_new = true;
            }
        }
        counts_.prefetches += is_new ? 1 : 0;
    }

    [[nodiscard]] RemoteCounts counts() const {
        const std::lock_guard lock(mutex_);
        RemoteCounts counts = counts_;
        counts.round_trips = time_;
        return counts;
    }
    /// How often rows of the chunk table were requested, by level.
    [[nodiscard]] std::map<int, std::uint64_t> rows_of_level() const {
        const std::lock_guard lock(mutex_);
        return rows_of_level_;
    }

  private:
    void arrive(const ArrayInfo& array, const Int3& chunk) const {
        const std::uint64_t bytes = source().row(array, chunk).bytes;
        ++counts_.decoded_chunks;
        counts_.decoded_bytes += bytes;
        const auto found = under_way_.find(array.row_of(chunk));
        if (found == under_way_.end()) {
            ++counts_.not_prefetched;
            ++counts_.fetched_chunks;
            counts_.fetched_bytes += bytes;
            ++time_;
            return;
        }
        // What was prefetched in this round trip has not arrived yet.
        time_ += found->second == time_ ? 1 : 0;
        under_way_.erase(found);
    }

    mutable std::mutex mutex_;
    mutable RemoteCounts counts_;
    mutable std::uint64_t time_ = 0;  ///< round trips that were waited for
    mutable std::map<std::uint64_t, std::uint64_t> under_way_;  ///< row of the table: when it was
                                                                ///< requested
    mutable std::map<int, std::uint64_t> rows_of_level_;
};

}  // namespace isonest::detail
