// The labels of the nodes in a part of a plane of a store.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "query/surface_nets/net_cell.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

/// Holds the chunks of the plane that came last, so that planes in ascending order decode none
/// twice. Thread-safety: none; one for each thread, on one cache.
class LabelPlanes {
  public:
    /// `name`: of the store. What is given must outlive it.
    LabelPlanes(ChunkCache& cache, const std::string& name)
        : cache_(cache),
          array_(cache.source().layout().array(0, Field::values)),
          bits_(cache.source().layout().header().labels),
          name_(name) {}

    /// Fills `to`, x fastest, with the labels of size.x * size.y nodes from `low` on in the plane
    /// low.z; those outside of the volume get kOutsideLabel, missing ones kMissingLabel. Throws
    /// Error{unsupported} for values that are no labels, and what the cache throws. REQUIRES:
    /// between two calls of begin() low.x, low.y and size are the same.
    void read(const Int3& low, const Int3& size, std::span<std::int64_t> to);
    /// Before another part of the volume.
    void begin() { held_.clear(); }
    /// Most bytes of chunks that are held for parts of this size.
    [[nodiscard]] static std::uint64_t held_bytes(const ArrayInfo& array, std::int64_t edge);

  private:
    struct Held {
        Int3 chunk;
        DecodedChunk data;  ///< null if all nodes have `all`
        std::int64_t all = 0;
    };
    void hold(const Int3& first, const Int3& last);
    void copy(const Held& held, const Int3& low, const Int3& size,
              std::span<std::int64_t> to) const;

    ChunkCache& cache_;
    const ArrayInfo& array_;
    bool bits_;
    const std::string& name_;
    std::vector<Held> held_;
};

}  // namespace isonest::detail
