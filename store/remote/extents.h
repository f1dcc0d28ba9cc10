// What of an object is in memory or on its way there.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <vector>

#include <isonest/error.h>

#include "store/bytes/store_bytes.h"

namespace isonest::detail {

/// The bytes of one request. They never move; [0, received) of them do not change any more.
struct Extent {
    enum class State : std::uint8_t {
        coming,   ///< asked for; its first bytes may be there
        present,  ///< all bytes are there
        failed,   ///< and out of the map
        replaced  ///< out of the map: its bytes are asked for by other extents
    };

    Extent(const ByteRange& of, std::shared_ptr<std::atomic<std::uint64_t>> alive);
    Extent(const Extent&) = delete;
    Extent& operator=(const Extent&) = delete;
    ~Extent();

    /// It takes no memory, although somebody still holds it. REQUIRES: it has no bytes, and this
    /// was not called before.
    void count_no_more();

    const ByteRange range;
    State state = State::coming;
    std::vector<std::byte> bytes;  ///< empty until the first come
    std::uint64_t received = 0;
    std::shared_ptr<const Error> failure = nullptr;
    std::uint64_t unread = 0;      ///< bytes that were asked for and nobody has read yet, about
    std::uint64_t round = 0;       ///< UrlBytes: whom it is a round trip for
    std::uint64_t generation = 0;  ///< of the announcement that it belongs to
    bool is_started = false;       ///< it is no longer in a queue
    bool is_urgent = false;        ///< somebody waits for it
    bool is_forgotten = false;     ///< on its way, and some of its bytes are wrong
    std::list<Extent*>::iterator place = {};  ///< in the order of use

  private:
    std::shared_ptr<std::atomic<std::uint64_t>> alive_;
};

/// Extents that do not overlap, by their offsets, and how much memory they take.
/// Thread-safety: none, but held extents may be let go at any time.
class Extents {
  public:
    explicit Extents(std::uint64_t budget_bytes)
        : budget_(budget_bytes), alive_(std::make_shared<std::atomic<std::uint64_t>>(0)) {}

    /// The parts of a range that are in no extent, by offset.
    [[nodiscard]] std::vector<ByteRange> absent(const ByteRange& range) const;
    /// The extents that have a part of a range, by offset. They count as used just now.
    [[nodiscard]] std::vector<std::shared_ptr<Extent>> use(const ByteRange& range);
    /// REQUIRES: absent(range) is the range.
    std::shared_ptr<Extent> insert(const ByteRange& range);
    /// Out of the map, if it is there; who holds it keeps it.
    void erase(Extent& extent);

    /// Bytes of all extents that are alive, in the map or held by somebody.
    [[nodiscard]] std::uint64_t alive() const { return alive_->load(); }
    /// Drops what was used least recently, and nobody holds, until so many more bytes fit into the
    /// budget, or nothing is left to drop. What has not been read goes last. Whether they fit.
    bool make_room(std::uint64_t bytes);
    /// The same, and what has not been read goes only if it was announced before the announcement
    /// that came before this generation's.
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
