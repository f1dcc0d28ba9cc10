// Ranges of objects elsewhere, kept in a folder: what was fetched once is there for the next run.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "store/bytes/range_cache.h"

namespace isonest::detail {

class CacheFolder;

/// Bytes are kept as parts of blocks of 64 KiB (CachedBlock), each a file (CacheFolder) under a
/// number that its object's state and its own number give. So a range is found whatever the ranges
/// were by which its bytes came, as long as all of its blocks are still there. A file's checksum is
/// compared whenever it is read, and the name of the object in it; one that is damaged is removed.
/// Files have URLs in them, but no file's name tells one.
///
/// Two processes that add to the same block at the same time may lose what one of them added.
/// Thread-safety: all methods from any thread.
class DiskCache {
  public:
    /// Makes the folder. `most_bytes`: that may lie in it, of all objects and processes that were
    /// given the same number. Throws Error{invalid_argument, io} if there cannot be such a folder.
    /// One that cannot be used for another reason is not: see warning().
    DiskCache(const std::filesystem::path& folder, std::uint64_t most_bytes);

    /// What is kept of an object in this state; it may outlive the cache. Null where the state has
    /// no version: then nobody could tell whether the object has changed.
    [[nodiscard]] std::unique_ptr<RangeCache> of(const ObjectState& object) const;
    /// The state in which the object with this `url` and `query` was found last, by remember(). Not
    /// that it still is in it. Nothing if that is not known.
    [[nodiscard]] std::optional<ObjectState> last_of(const ObjectState& object) const;
    void remember(const ObjectState& object) const;
    /// One line that says why the cache is off, or why nothing is added to it. Empty: it works.
    [[nodiscard]] std::string warning() const;

  private:
    std::shared_ptr<CacheFolder> folder_;
};

}  // namespace isonest::detail
