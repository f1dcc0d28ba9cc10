// The bytes of an object elsewhere: what was asked for is kept within a budget, and comes by few
// requests.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "store/bytes/range_cache.h"
#include "store/bytes/store_bytes.h"
#include "store/remote/background.h"
#include "store/remote/extents.h"
#include "store/remote/fetch_loop.h"
#include "store/remote/object_url.h"
#include "store/remote/remote_options.h"

namespace isonest::detail {

/// fetched().round_trips is the length of the longest chain of requests of which each was asked for
/// (by read() or want()) after somebody had waited for the one before. So all waits for ranges that
/// were asked for before the first of these waits ended count once, and what came before anybody
/// needed it counts nothing. Opening is the first.
///
/// What the cache has of announced ranges is loaded, and what was fetched is kept in it, by a
/// thread for each: a cache that makes room may take long, and the network does not wait for it.
/// What is to be kept takes at most a quarter of the budget until it is; of more, nothing is kept.
class UrlBytes : public StoreBytes {
  public:
    static constexpr std::uint64_t kTailBytes = 64U << 10U;
    /// Of an object that was opened before, and whose end the cache has.
    static constexpr std::uint64_t kKnownTailBytes = 64;

    /// Throws as open_url().
    UrlBytes(ObjectUrl url, RemoteOptions options);
    /// Waits until what is to be kept is in the cache; where options.check has thrown, for 0.2 s at
    /// most.
    ~UrlBytes() override;

    [[nodiscard]] const std::string& name() const override { return object_.name; }
    [[nodiscard]] std::uint64_t size() const override { return state_.size; }
    [[nodiscard]] std::string version() const override { return version_; }
    [[nodiscard]] bool is_far() const override { return true; }
    [[nodiscard]] HeldBytes read(std::uint64_t offset, std::uint64_t size) const override;
    /// What does not fit into the budget is asked for as soon as what was announced before has been
    /// read.
    void want(std::span<const ByteRange> ranges) const override;
    void forget(const ByteRange& range) const override;
    [[nodiscard]] FetchedCounts fetched() const override;
    /// The object as it was opened.
    [[nodiscard]] const ObjectState& state() const { return state_; }

  private:
    using Lock = std::unique_lock<std::mutex>;
    using ExtentPointer = std::shared_ptr<Extent>;
    class ExtentJob;
    class OpeningJob;

    /// When ranges were asked for.
    struct Place {
        std::uint64_t round = 0;
        std::uint64_t generation = 0;  ///< of want()
    };
    /// Ranges of one want(); those before `next` have been asked for.
    struct Announced {
        std::vector<ByteRange> ranges;  ///< by offset
        std::size_t next = 0;
        Place place;
    };

    void use_cache();
    /// With the lock held.
    [[nodiscard]] bool take_known_tail(const std::vector<std::byte>& tail);
    void keep_later(const ExtentPointer& extent) const;
    void load_next_batch() const;
    std::shared_ptr<FetchJob> next_job() const;
    /// Calls check(), and notes that it threw.
    void check_whoever_waits() const;
    /// Throws what check() throws, and what broke the object.
    void wait_until(Lock& lock, const std::function<bool()>& is_over) const;
    /// Whether the extent has its first `until` bytes: not if it was replaced by others.
    bool wait_for(Lock& lock, const ExtentPointer& extent, std::uint64_t until) const;
    /// All that have a part of the range; what is in none is asked for.
    std::vector<ExtentPointer> extents_for(Lock& lock, const ByteRange& range) const;
    void load_from_cache(const std::vector<ExtentPointer>& wanted) const;
    /// If the extent is announced and its cache has not been looked at: that, with its batch.
    void load_announced(Lock& lock, const ExtentPointer& extent) const;
    void end_extent(Extent& extent, Extent::State state,
                    std::shared_ptr<const Error> failure) const;
    static HeldBytes held(const std::vector<ExtentPointer>& extents, const ByteRange& range);
    // With the lock held:
    void ask_for_announced() const;
    [[nodiscard]] bool is_distrusted(const ByteRange& range) const;
    void ask(const std::vector<ByteRange>& absent, const Place& place, bool is_urgent) const;
    std::vector<ExtentPointer> hold_places(const std::vector<ByteRange>& absent, const Place& place,
                                           bool is_urgent) const;

    mutable FetchObject object_;
    bool has_query_;
    std::string query_;  ///< of ObjectState
    RemoteOptions options_;
    ObjectState state_;
    std::optional<ObjectState> known_;  ///< of an earlier opening
    std::string version_;               ///< also a weak one, or a time, which a cache cannot go by
    std::shared_ptr<RangeCache> cache_;
    bool is_open_ = false;

    mutable std::mutex mutex_;
    mutable std::condition_variable changed_;
    mutable Extents extents_;
    mutable std::deque<ExtentPointer> urgent_;
    mutable std::deque<ExtentPointer> hinted_;
    mutable std::deque<std::vector<ExtentPointer>> to_load_;  ///< announced; cache_ may have them
    mutable std::deque<Announced> announced_;
    mutable std::deque<ByteRange> distrusted_;     ///< the cache may have wrong bytes of it
    mutable std::shared_ptr<const Error> broken_;  ///< nothing can be read any more
    mutable bool is_closing_ = false;              ///< nothing more is asked for
    mutable std::uint64_t rounds_ = 0;
    mutable std::uint64_t generation_ = 0;
    mutable std::atomic<std::uint64_t> cache_bytes_{0};
    mutable std::atomic<bool> was_cancelled_{false};
    mutable std::shared_ptr<FetchJob> opening_;
    // Their threads use the others.
    mutable FetchLoop loop_;
    std::unique_ptr<Background> loading_;  ///< null: there is no cache
    std::unique_ptr<Background> keeping_;  ///< the same
};

}  // namespace isonest::detail
