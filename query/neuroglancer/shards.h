// Meshes of many labels in few files.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "query/simplify/block_files.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// How labels are distributed: label L is in shard L modulo 2^shard_bits.
struct Sharding {
    int shard_bits = 0;

    /// For this many labels: about 64 to 128 in a shard.
    static Sharding of(std::uint64_t labels);
    [[nodiscard]] std::uint64_t shard_of(std::uint64_t label) const {
        return label & ((std::uint64_t{1} << shard_bits) - 1);
    }
    /// "0a.shard": the shard's file.
    [[nodiscard]] std::string file_name(std::uint64_t shard) const;
    /// The member "sharding" of the file `info`, an object.
    [[nodiscard]] std::string json() const;
};

/// Collects the meshes of labels in a temporary file and writes them as shards: the format
/// neuroglancer_uint64_sharded_v1, with the identity as its hash, one minishard in each shard, and
/// no compression beyond that of the fragments. The files depend on the meshes alone.
class Shards {
  public:
    explicit Shards(const ScratchFolder& folder) : bytes_(folder), meshes_(folder) {}

    /// Adds a label's fragments and its manifest; each label once. Thread-safe. Throws Error{io}.
    void add(std::uint64_t label, std::span<const std::byte> fragments,
             std::span<const std::byte> manifest);
    /// Call once after all were added. Existing files are replaced. Throws Error{io}.
    Sharding write(const std::filesystem::path& folder);

  private:
    struct Mesh {
        std::uint64_t label = 0;
        std::uint64_t first = 0;  ///< byte in the temporary file
        std::uint64_t fragments = 0;
        std::uint64_t manifest = 0;
        std::uint64_t shard = 0;
    };
    void write_shard(const std::filesystem::path& file, std::span<const Mesh> meshes) const;

    std::mutex mutex_;
    PiecedFile bytes_;
    std::uint64_t end_ = 0;
    GrowingFile<Mesh> meshes_;
};

}  // namespace isonest::detail
