// The finest level of a volume without a store, as chunks of one layer in memory.
#pragma once

#include <array>
#include <vector>

#include <isonest/volume_source.h>

#include "query/slabs/slab_reader.h"
#include "store/container/chunk_source.h"

namespace isonest::detail {

/// The header that a store of the volume would have, with chunks of so many nodes per axis and only
/// the values as field. The chunk borders do not affect meshes.
StoreHeader chunked_header_of(const VolumeDescription& volume, int chunk);

/// For all chunks in layer `layer` (along z) the nodes, and for those in the adjacent layers the
/// nodes in the loaded planes; others are 0. The rows of the table give the range of the available
/// nodes, and whether one of them is missing. Thread-safe.
class VolumeChunks : public ChunkSource {
  public:
    /// `cells`: of the layer of chunks. REQUIRES: `planes` is the result of SlabReader::read() for
    /// them, and outlives this object.
    VolumeChunks(const StoreLayout& layout, const SlabPlanes& planes, const Slab& cells);

    [[nodiscard]] const StoreLayout& layout() const override { return layout_; }
    [[nodiscard]] ChunkRow row(const ArrayInfo& array, const Int3& chunk) const override;
    void decode(const ArrayInfo& array, const Int3& chunk, std::span<std::byte> raw) const override;

    /// Range of the layer's own nodes only.
    [[nodiscard]] std::array<double, 2> range() const { return range_; }
    [[nodiscard]] bool has_missing() const { return has_missing_; }
    /// Heap in addition to the planes, bytes.
    static std::uint64_t heap(const StoreLayout& layout);

  private:
    template <class T>
    void fill_rows();

    const StoreLayout& layout_;
    const ArrayInfo& values_;
    const SlabPlanes& planes_;
    std::int64_t layer_;
    std::int64_t begin_;  ///< range of the planes of nodes that are used
    std::int64_t end_;
    std::vector<ChunkRow> rows_;  ///< of the layers before, at and behind `layer`, x fastest
    std::array<double, 2> range_{};
    bool has_missing_ = false;
};

}  // namespace isonest::detail
