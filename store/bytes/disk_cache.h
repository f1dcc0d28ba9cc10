// Cache of ranges of remote objects in a folder, shared by successive runs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "store/bytes/store_bytes.h"

namespace isonest::detail {

// One block of an object as kept by a disk cache, and the contents of its file.

/// Some of the parts (ranges of bytes) of a block of kBytes bytes. A file contains, in the
/// machine's byte order: eight letters, XXH64 of everything after it, the block's number, the
/// length of the object's name and the number of parts, the parts (begin and size) in order, the
/// name, the bytes of the parts.
class CachedBlock {
  public:
    static constexpr std::size_t kBytes = std::size_t{64} << 10U;
    /// Maximum size of a file. If an object's name leaves no room for this, its blocks are not
    /// kept.
    static constexpr std::size_t kMaxFileBytes = 2 * kBytes;

    /// An empty block.
    CachedBlock() = default;
    /// Nullopt if `file` is damaged, or holds another block or a block of another object.
    static std::optional<CachedBlock> decode(std::span<const std::byte> file,
                                             std::string_view object, std::uint64_t number);
    /// Empty if the result would be larger than kMaxFileBytes.
    [[nodiscard]] std::vector<std::byte> encode(std::string_view object,
                                                std::uint64_t number) const;

    /// Copies [from, from + to.size()); false if a part of it is missing. REQUIRES: the range lies
    /// within the block. The same for add().
    [[nodiscard]] bool copy(std::size_t from, std::span<std::byte> to) const;
    /// False if all bytes were already present.
    bool add(std::size_t from, std::span<const std::byte> bytes);
    /// Removes [from, from + size). REQUIRES: the range lies within the block.
    void remove(std::size_t from, std::size_t size);
    [[nodiscard]] bool empty() const { return parts_.empty(); }

  private:
    struct Part {
        std::uint32_t from = 0;
        std::uint32_t size = 0;
        [[nodiscard]] std::size_t end() const { return std::size_t{from} + size; }
    };
    [[nodiscard]] bool has(std::size_t from, std::size_t size) const;

    std::vector<Part> parts_;       ///< in order, with gaps between them
    std::vector<std::byte> bytes_;  ///< of the whole block; empty if there are no parts
};

class CacheFolder;

/// Bytes are kept as parts of blocks of 64 KiB (CachedBlock), each in a file (CacheFolder) whose
/// number is derived from the object's state and the block's number. So a range can be loaded
/// whatever ranges its bytes were fetched in, as long as all of its blocks are still present. The
/// checksum of a file and the name of the object in it are compared whenever it is read; damaged
/// files are removed. Files contain URLs, but file names do not reveal them.
///
/// Two processes that add to the same block at the same time may lose what one of them added.
/// Thread-safety: all methods from any thread.
class DiskCache {
  public:
    /// Creates the folder. `max_bytes`: the maximum in the folder, over all objects and all
    /// processes that were given the same number. Throws Error{invalid_argument, io} if the folder
    /// cannot be created. If it cannot be used for another reason, the cache is off: see warning().
    DiskCache(const std::filesystem::path& folder, std::uint64_t max_bytes);

    /// The cache of an object in this state; it may outlive this object. Null if the state has no
    /// version, because changes of the object could then not be detected.
    [[nodiscard]] std::unique_ptr<RangeCache> of(const ObjectState& object) const;
    /// The last known state of the object with this `url` and `query`, from remember(); the object
    /// may have changed since. Nullopt if unknown.
    [[nodiscard]] std::optional<ObjectState> last_of(const ObjectState& object) const;
    void remember(const ObjectState& object) const;
    /// One line that says why the cache is off, or why nothing is added to it. Empty: it works.
    [[nodiscard]] std::string warning() const;

  private:
    std::shared_ptr<CacheFolder> folder_;
};

}  // namespace isonest::detail
