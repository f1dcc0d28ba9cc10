// Ranges of an object: which requests fetch them, and which are in memory or on their way.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <vector>

#include <isonest/error.h>

#include "store/bytes/store_bytes.h"

namespace isonest::detail {

// Which requests fetch a set of ranges.

/// The offset after its last byte.
inline std::uint64_t end_of(const ByteRange& range) {
    return range.offset + range.size;
}

struct JoinLimits {
    std::uint64_t gap = 16U << 10U;  ///< maximum bytes between two ranges that are fetched by one
                                     ///< request
    std::uint64_t largest = 8U << 20U;  ///< bytes of one request
    /// At most one of this many fetched bytes may be waste.
    std::uint64_t waste_part = 5;
};

struct JoinedRange {
    ByteRange range;
    std::uint64_t wanted = 0;  ///< bytes of it that were requested
};

/// `ranges`: not empty, sorted by offset, without overlap. `may_fetch`: whether the bytes of a gap
/// are neither present nor under way. The smallest gaps are joined first, so that there are as few
/// requests as the waste limit permits. Adjacent ranges are always joined, up to the largest
/// request; larger ranges are cut into equal pieces.
std::vector<JoinedRange> join_ranges(const std::vector<ByteRange>& ranges, const JoinLimits& limits,
                                     const std::function<bool(const ByteRange&)>& may_fetch);

// The parts of an object that are in memory or on their way.

/// The bytes of one request. They never move; [0, received) do not change any more.
struct Extent {
    enum class State : std::uint8_t {
        coming,   ///< requested; its first bytes may be present
        present,  ///< all bytes are present
        failed,   ///< removed from the map
        replaced  ///< removed from the map: its bytes are requested by other extents
    };

    Extent(const ByteRange& of, std::shared_ptr<std::atomic<std::uint64_t>> alive);
    Extent(const Extent&) = delete;
    Extent& operator=(const Extent&) = delete;
    ~Extent();

    /// Excludes it from the memory count, although somebody still holds it. REQUIRES: it has no
    /// bytes, and this was not called before.
    void count_no_more();

    const ByteRange range;
    State state = State::coming;
    std::vector<std::byte> bytes;  ///< empty until the first come
    std::uint64_t received = 0;
    std::shared_ptr<const Error> failure = nullptr;
    std::uint64_t unread = 0;      ///< approximate bytes that were requested and not read yet
    std::uint64_t round = 0;       ///< UrlBytes: the round trip that waits for it
    std::uint64_t generation = 0;  ///< of the prefetch that it belongs to
    bool is_started = false;       ///< no longer in a queue
    bool is_urgent = false;        ///< somebody waits for it
    bool is_forgotten = false;     ///< under way, and some of its bytes are wrong
    std::list<Extent*>::iterator place = {};  ///< in the order of use

  private:
    std::shared_ptr<std::atomic<std::uint64_t>> alive_;
};

/// Extents that do not overlap, by their offsets, and the memory that they use.
/// Thread-safety: none, but held extents may be released at any time.
class Extents {
  public:
    explicit Extents(std::uint64_t budget_bytes)
        : budget_(budget_bytes), alive_(std::make_shared<std::atomic<std::uint64_t>>(0)) {}

    /// The parts of a range that are in no extent, sorted by offset.
    [[nodiscard]] std::vector<ByteRange> absent(const ByteRange& range) const;
    /// The extents that overlap a range, sorted by offset. Marks them as just used.
    [[nodiscard]] std::vector<std::shared_ptr<Extent>> use(const ByteRange& range);
    /// REQUIRES: absent(range) is the whole range.
    std::shared_ptr<Extent> insert(const ByteRange& range);
    /// Removes an extent from the map, if it is there. It exists until nobody holds it any more.
    void erase(Extent& extent);

    /// Bytes of all extents that exist, in the map or held by somebody.
    [[nodiscard]] std::uint64_t alive() const { return alive_->load(); }
    /// Drops the least recently used extents that nobody holds until `bytes` more fit into the
    /// budget, or nothing is left to drop; extents that have not been read are dropped last.
    /// Returns whether they fit.
    bool make_room(std::uint64_t bytes);
    /// The same for the prefetch number `generation`, but extents that have not been read are
    /// dropped only if they belong to neither this prefetch nor the one before it.
    bool make_room_for_hint(std::uint64_t bytes, std::uint64_t generation);

  private:
    template <class MayDrop>
    bool drop_until_fits(std::uint64_t bytes, const MayDrop& may_drop);
    template <class MayDrop>
    bool drop_those(std::uint64_t bytes, const MayDrop& may_drop);

    std::uint64_t budget_;
    std::shared_ptr<std::atomic<std::uint64_t>> alive_;
    std::map<std::uint64_t, std::shared_ptr<Extent>> by_offset_;
    std::list<Extent*> by_use_;  ///< the least recently used one first
};

}  // namespace isonest::detail
