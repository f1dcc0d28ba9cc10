// A chunk source that behaves like one behind a network, without one, and counts round trips: for
// tests and programs that measure.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <span>

#include "store/container/wrapping/forwarding_source.h"

namespace isonest::detail {

/// What a network would have carried.
struct FarCounts {
    std::uint64_t round_trips = 0;
    std::uint64_t announcements = 0;    ///< calls of prefetch_all() that named a chunk
    std::uint64_t unannounced = 0;      ///< decoded chunks that nobody had announced
    std::uint64_t decoded_bytes = 0;    ///< stored bytes of the chunks that were decoded
    std::uint64_t decoded_chunks = 0;   ///< how many, those decoded twice counted twice
    std::uint64_t announced_bytes = 0;  ///< stored bytes of those that were announced
    std::uint64_t announced_chunks = 0;
};

/// The model: a chunk's bytes are there once, for the next decode(). Who decodes a chunk that is
/// not there waits one round trip, in which all that was announced before arrives, too. A chunk
/// that is announced and was not decoded since is not announced again.
class FarSource : public ForwardingSource {
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
        FarSource::prefetch_all({&wanted, 1});
    }
    [[nodiscard]] bool is_far() const override { return true; }
    void prefetch_all(std::span<const WantedChunk> chunks) const override {
        const std::lock_guard lock(mutex_);
        bool is_new = false;
        for (const WantedChunk& wanted : chunks) {
            const ArrayInfo& array = *wanted.array;
            if (!array.has_chunk(wanted.chunk)) {
                continue;
            }
            if (under_way_.try_emplace(array.row_of(wanted.chunk), time_).second) {
                counts_.announced_bytes += source().row(array, wanted.chunk).bytes;
                ++counts_.announced_chunks;
                is_new = true;
            }
        }
        counts_.announcements += is_new ? 1 : 0;
    }

    [[nodiscard]] FarCounts counts() const {
        const std::lock_guard lock(mutex_);
        FarCounts counts = counts_;
        counts.round_trips = time_;
        return counts;
    }
    /// How often a row of the chunk table was asked for, by level.
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
            ++counts_.unannounced;
            ++counts_.announced_chunks;
            counts_.announced_bytes += bytes;
            ++time_;
            return;
        }
        // What was announced in this round trip has not arrived.
        time_ += found->second == time_ ? 1 : 0;
        under_way_.erase(found);
    }

    mutable std::mutex mutex_;
    mutable FarCounts counts_;
    mutable std::uint64_t time_ = 0;  ///< round trips that somebody waited for
    mutable std::map<std::uint64_t, std::uint64_t> under_way_;  ///< row of the table: since when
    mutable std::map<int, std::uint64_t> rows_of_level_;
};

}  // namespace isonest::detail
