// A chunk source that stands before another one.
#pragma once

#include <optional>
#include <span>

#include "store/container/chunk_source.h"

namespace isonest::detail {

/// Passes every call on to `source`, which must outlive it: derived classes override what differs.
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
    [[nodiscard]] bool is_far() const override { return source_.is_far(); }
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

}  // namespace isonest::detail
