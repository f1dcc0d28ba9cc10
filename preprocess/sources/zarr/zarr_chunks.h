// The stored numbers of a Zarr array, chunk by chunk.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/int3.h>
#include <isonest/open_volume.h>
#include <isonest/volume_source.h>

#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/zarr/zarr_array.h"
#include "preprocess/sources/zarr/zarr_files.h"
#include "preprocess/sources/zarr/zarr_image.h"

namespace isonest::detail {

// Which nodes of a volume the caller needs, so that other chunks need not be read.

/// The nodes that SourceOptions::crop and `every` select in a volume whose axes may still run
/// backward.
class NeededNodes {
  public:
    /// `nodes`: of the volume. An invalid crop selects all nodes, as cropped() will report it.
    NeededNodes(const Int3& nodes, const SourceOptions& options,
                const std::array<bool, 3>& backward)
        : nodes_(nodes), hi_(nodes), backward_(backward) {
        for (int a = 0; a < 3; ++a) {
            const NodeRange& range = options.crop.at(static_cast<std::size_t>(a));
            const std::int64_t n = nodes[a];
            const auto place = [n](std::int64_t at) { return at < 0 ? at + n : at; };
            const std::int64_t lo = place(range.from.value_or(0));
            const std::int64_t hi = place(range.to.value_or(n));
            if (lo >= 0 && lo < hi && hi <= n && options.every[a] >= 1) {
                lo_[a] = lo;
                hi_[a] = hi;
                every_[a] = options.every[a];
            }
        }
    }
    explicit NeededNodes(const Int3& nodes) : NeededNodes(nodes, {}, {}) {}

    /// Whether any node in [begin, end) is needed, along an axis as stored. REQUIRES: begin < end.
    [[nodiscard]] bool any(int axis, std::int64_t begin, std::int64_t end) const {
        const bool turned = backward_.at(static_cast<std::size_t>(axis));
        const std::int64_t from = turned ? nodes_[axis] - end : begin;
        const std::int64_t to = turned ? nodes_[axis] - begin : end;
        const std::int64_t behind =
            from <= lo_[axis] ? 0 : ceil_div(from - lo_[axis], every_[axis]);
        return lo_[axis] + behind * every_[axis] < std::min(to, hi_[axis]);
    }

  private:
    Int3 nodes_;
    Int3 lo_{0, 0, 0};
    Int3 hi_;
    Int3 every_{1, 1, 1};
    std::array<bool, 3> backward_;
};

// The compressed bytes of a Zarr array's chunks, in separate files or in shards.

std::uint64_t product(const Lengths& lengths);

/// Thread-safety: all methods from any thread.
class PackedChunks {
  public:
    /// `name`: of the array, for messages. `array` must outlive this object.
    PackedChunks(std::shared_ptr<ZarrFiles> files, const ZarrArray& array, std::string name);

    [[nodiscard]] ZarrFiles& files() const { return *files_; }
    [[nodiscard]] const std::string& name() const { return name_; }
    [[nodiscard]] std::uint64_t chunk_bytes() const { return chunk_bytes_; }  ///< uncompressed
    /// Maximum size of a chunk before the last codec, if filters increase it.
    [[nodiscard]] std::uint64_t max_bytes() const { return max_bytes_; }
    /// Chunks per shard along each axis; empty without shards.
    [[nodiscard]] const Lengths& per_shard() const { return per_shard_; }
    [[nodiscard]] std::uint64_t index_bytes() const { return index_bytes_; }  ///< 0 without shards

    struct ShardIndex {
        std::filesystem::path file;
        std::uint64_t size = 0;  ///< of the file
        std::string entries;     ///< empty: there is no file
        std::shared_ptr<const void> state = nullptr;
    };
    /// Throws Error{corrupt, io}.
    [[nodiscard]] ShardIndex read_index(const Lengths& shard) const;
    /// None if this would have to wait.
    [[nodiscard]] std::optional<ShardIndex> index_at_hand(const Lengths& shard) const;

    /// The bytes of a chunk; empty if it is not stored. `index`: of its shard, null without shards.
    /// Throws Error{corrupt, io}.
    [[nodiscard]] std::vector<std::byte> read(const Lengths& chunk, const ShardIndex* index) const;
    /// For messages.
    [[nodiscard]] std::string where(const Lengths& chunk) const;

    /// The part to prefetch for a chunk; none if it is not stored, or the index is invalid.
    [[nodiscard]] std::optional<ZarrPart> part_of(const Lengths& chunk,
                                                  const ShardIndex* index) const;
    [[nodiscard]] ZarrPart index_part(const Lengths& shard) const;

  private:
    /// Offset and size in the shard; none if it is not stored.
    [[nodiscard]] std::optional<ByteRange> entry_of(const Lengths& chunk,
                                                    const ShardIndex& index) const;
    [[nodiscard]] std::uint64_t stored_index_bytes() const;
    [[nodiscard]] ShardIndex unpacked(std::filesystem::path file, ZarrIndexBytes bytes) const;

    std::shared_ptr<ZarrFiles> files_;
    const ZarrArray& array_;
    std::string name_;
    std::uint64_t chunk_bytes_ = 0;
    std::uint64_t max_bytes_ = 0;
    Lengths per_shard_;
    std::uint64_t index_bytes_ = 0;
};

/// The selected volume of an array, neither mirrored nor scaled; float16 and 64-bit integers as
/// their bits (scaled_source.h). As many threads decode as `max_heap` bytes allow. Nodes that are
/// not needed have the fill value if no node of their chunk is. Throws Error{limit} if `max_heap`
/// bytes are too few for one chunk.
std::unique_ptr<VolumeSource> zarr_chunks(std::shared_ptr<ZarrFiles> files, ZarrImage image,
                                          ChosenAxes chosen, Placement place,
                                          std::optional<LengthUnit> unit, std::uint64_t max_heap,
                                          const NeededNodes& needed, std::string name);

}  // namespace isonest::detail
