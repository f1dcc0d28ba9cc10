// Where ranges of an object that is elsewhere may be kept nearer, as on a disk.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "store/bytes/store_bytes.h"

namespace isonest::detail {

/// What of one object, in one state of it, is kept elsewhere than at its server.
/// Thread-safety: all methods from any thread.
class RangeCache {
  public:
    RangeCache() = default;
    RangeCache(const RangeCache&) = delete;
    RangeCache& operator=(const RangeCache&) = delete;
    virtual ~RangeCache() = default;

    /// All bytes of this range, which may have been kept as parts of other ranges; nothing if any
    /// of them is not there or is damaged: then they are fetched. Never throws for what the cache
    /// itself cannot do.
    [[nodiscard]] virtual std::optional<std::vector<std::byte>> load(ByteRange range) = 0;
    /// Offers the bytes of this range, range.size of them. What cannot be kept is left out without
    /// a word: the cache only saves time.
    virtual void keep(ByteRange range, std::span<const std::byte> bytes) = 0;
    /// What is kept of this range is not what was written, and is kept no longer.
    virtual void forget(ByteRange range) = 0;
};

/// An object in the state in which it was opened: what a cache is kept under.
struct ObjectState {
    std::string url;  ///< without userinfo and query
    /// Its strong ETag as the server wrote it, or "last-modified: ..." where it has none and the
    /// URL no query. Empty without either: then nothing may be kept beyond this opening.
    std::string version;
    std::uint64_t size = 0;  ///< bytes
    /// Tells apart what URLs with the same `url` name by their queries; has no secrets.
    std::string query = {};
};

}  // namespace isonest::detail
