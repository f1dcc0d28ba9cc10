// A volume's planes, slab by slab, from where they lie in memory or from whatever reads them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <isonest/volume_source.h>

#include "query/slabs/marched_slab.h"

namespace isonest::detail {

/// Planes of nodes, dense, x fastest.
struct SlabPlanes {
    const std::byte* data = nullptr;  ///< of plane `first`
    std::int64_t first = 0;
    std::vector<std::byte> own = {};  ///< where the data are, if they do not lie in the volume
};

/// Reads each plane once, in ascending order. Not thread-safe.
class SlabReader {
  public:
    explicit SlabReader(VolumeSource& volume);

    /// The planes of the layers, and one more on each side where the volume has it. REQUIRES: slabs
    /// come in ascending order, without gaps, from the first layer on. Throws what the volume
    /// throws.
    SlabPlanes read(const Slab& layers);

    /// Bytes of heap that the reader holds, and each of its results, for slabs of so many layers.
    [[nodiscard]] std::uint64_t own_bytes(std::int64_t layers) const;
    [[nodiscard]] std::uint64_t slab_bytes(std::int64_t layers) const;

  private:
    VolumeSource& volume_;
    VolumeDescription description_;
    std::span<const std::byte> mapped_;
    std::uint64_t plane_bytes_;
    std::int64_t at_once_;  ///< planes that are read together
    std::vector<std::byte> window_;
    std::int64_t window_first_ = 0;  ///< its first plane
    std::int64_t window_end_ = 0;
};

}  // namespace isonest::detail
