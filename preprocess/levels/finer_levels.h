// What the blocks of a level read of the levels below.
#pragma once

#include <isonest/int3.h>

#include "store/container/chunk_cache.h"
#include "store/container/format.h"

namespace isonest::detail {

/// Thread-safety: chunk() from any thread.
class FinerLevels {
  public:
    FinerLevels() = default;
    FinerLevels(const FinerLevels&) = delete;
    FinerLevels& operator=(const FinerLevels&) = delete;
    virtual ~FinerLevels() = default;
    /// The nodes of a chunk of values, or of the deviations of level 1; their stride along x is 1.
    /// Those that the block at work does not need may be anything. Throws Error{io, corrupt}.
    virtual ChunkNodes chunk(const ArrayInfo& array, const Int3& chunk) = 0;
};

/// Those in a store that is being written, through a cache of `bytes`.
class CachedLevels : public FinerLevels {
  public:
    CachedLevels(const ChunkSource& store, std::uint64_t bytes) : cache_(store, bytes) {}
    ChunkNodes chunk(const ArrayInfo& array, const Int3& chunk) override {
        return {cache_.get(array, chunk), {1, array.chunk.x, array.chunk.x * array.chunk.y}};
    }

  private:
    ChunkCache cache_;
};

}  // namespace isonest::detail
