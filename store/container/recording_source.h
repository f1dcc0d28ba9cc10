// A chunk source that writes down which chunks are decoded: for tests and programs that measure.
#pragma once

#include <map>
#include <mutex>
#include <span>

#include "store/container/chunk_source.h"

namespace isonest::detail {

/// Passes everything on to `source`, which must outlive it.
class RecordingSource : public ChunkSource {
  public:
    explicit RecordingSource(const ChunkSource& source) : source_(source) {}
    [[nodiscard]] const StoreLayout& layout() const override { return source_.layout(); }
    [[nodiscard]] ChunkRow row(const ArrayInfo& array, const Int3& chunk) const override {
        return source_.row(array, chunk);
    }
    void decode(const ArrayInfo& array, const Int3& chunk,
                std::span<std::byte> raw) const override {
        source_.decode(array, chunk, raw);
        const std::lock_guard lock(mutex_);
        ++decoded_[array.row_of(chunk)];
    }
    [[nodiscard]] std::optional<CubeRange> cube_range(int level, const Int3& cube) const override {
        return source_.cube_range(level, cube);
    }
    void prefetch(const ArrayInfo& array, const Int3& chunk) const override {
        source_.prefetch(array, chunk);
    }
    void prefetch_rows(const ArrayInfo& array, const Int3& begin, const Int3& end) const override {
        source_.prefetch_rows(array, begin, end);
    }
    [[nodiscard]] bool is_far() const override { return source_.is_far(); }
    void prefetch_all(std::span<const WantedChunk> chunks) const override {
        source_.prefetch_all(chunks);
    }
    /// How often each was decoded, by row of the chunk table. REQUIRES: no decode() at the same
    /// time.
    [[nodiscard]] const std::map<std::uint64_t, int>& decoded() const { return decoded_; }

  private:
    const ChunkSource& source_;
    mutable std::mutex mutex_;
    mutable std::map<std::uint64_t, int> decoded_;
};

}  // namespace isonest::detail
