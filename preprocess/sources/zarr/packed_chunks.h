// The packed bytes of a Zarr array's chunks, which have files of their own or lie in shards.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/sources/zarr/zarr_array.h"
#include "preprocess/sources/zarr/zarr_files.h"

namespace isonest::detail {

std::uint64_t product(const Lengths& lengths);

/// Thread-safety: all methods from any thread.
class PackedChunks {
  public:
    /// `name`: of the array, for messages. `array` outlives this.
    PackedChunks(std::shared_ptr<ZarrFiles> files, const ZarrArray& array, std::string name);

    [[nodiscard]] ZarrFiles& files() const { return *files_; }
    [[nodiscard]] const std::string& name() const { return name_; }
    [[nodiscard]] std::uint64_t chunk_bytes() const { return chunk_bytes_; }  ///< unpacked
    /// The most of a chunk before the last codec, if filters make more bytes of it.
    [[nodiscard]] std::uint64_t most_bytes() const { return most_bytes_; }
    /// Chunks along each axis; empty without shards.
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
    /// Nothing if that had to be waited for.
    [[nodiscard]] std::optional<ShardIndex> index_at_hand(const Lengths& shard) const;

    /// Of a chunk; empty where it is not stored. `index`: of its shard, null without shards.
    /// Throws Error{corrupt, io}.
    [[nodiscard]] std::vector<std::byte> read(const Lengths& chunk, const ShardIndex* index) const;
    /// For messages.
    [[nodiscard]] std::string where(const Lengths& chunk) const;

    /// What of a chunk can be announced; nothing where it is not stored, or the index is wrong.
    [[nodiscard]] std::optional<ZarrPart> part_of(const Lengths& chunk,
                                                  const ShardIndex* index) const;
    [[nodiscard]] ZarrPart index_part(const Lengths& shard) const;

  private:
    /// Offset and size in the shard; nothing where it is not stored.
    [[nodiscard]] std::optional<ByteRange> entry_of(const Lengths& chunk,
                                                    const ShardIndex& index) const;
    [[nodiscard]] std::uint64_t stored_index_bytes() const;
    [[nodiscard]] ShardIndex unpacked(std::filesystem::path file, ZarrIndexBytes bytes) const;

    std::shared_ptr<ZarrFiles> files_;
    const ZarrArray& array_;
    std::string name_;
    std::uint64_t chunk_bytes_ = 0;
    std::uint64_t most_bytes_ = 0;
    Lengths per_shard_;
    std::uint64_t index_bytes_ = 0;
};

}  // namespace isonest::detail
