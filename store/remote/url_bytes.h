// The bytes of a remote object: what was requested is kept within a memory budget, and is fetched
// by few requests.
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

#include "store/bytes/store_bytes.h"
#include "store/remote/fetch_loop.h"
#include "store/remote/object_url.h"
#include "store/remote/ranges.h"

namespace isonest::detail {

/// fetched().round_trips is the length of the longest chain of requests, each of which was made (by
/// read() or want()) after somebody had waited for the previous one. So all waits for ranges that
/// were requested before the first of these waits ended count once, and ranges that arrived before
/// they were needed do not count. Opening is the first round trip.
///
/// One thread loads prefetched ranges from the cache, another one keeps fetched ranges in it: a
/// cache that makes room may take long, and the network must not wait for it. Data waiting to be
/// kept take at most a quarter of the budget; beyond that, nothing is kept.
class UrlBytes : public StoreBytes {
  public:
    static constexpr std::uint64_t kTailBytes = 64U << 10U;
    /// For an object that was opened before, and whose end is in the cache.
    static constexpr std::uint64_t kKnownTailBytes = 64;

    /// Throws what open_url() throws.
    UrlBytes(ObjectUrl url, RemoteOptions options);
    /// Waits until the cache has everything that is to be kept; if options.check has thrown, for at
    /// most 0.2 s.
    ~UrlBytes() override;

    [[nodiscard]] const std::string& name() const override { return object_.name; }
    [[nodiscard]] std::uint64_t size() const override { return state_.size; }
    [[nodiscard]] std::string version() const override { return version_; }
    [[nodiscard]] bool is_remote() const override { return true; }
    [[nodiscard]] HeldBytes read(std::uint64_t offset, std::uint64_t size) const override;
    /// Ranges that do not fit into the budget are requested as soon as bytes that were prefetched
    /// before have been read.
    void want(std::span<const ByteRange> ranges) const override;
    void forget(const ByteRange& range) const override;
    [[nodiscard]] FetchedCounts fetched() const override;
    /// The state of the object when it was opened.
    [[nodiscard]] const ObjectState& state() const { return state_; }

  private:
    using Lock = std::unique_lock<std::mutex>;
    using ExtentPointer = std::shared_ptr<Extent>;
    class ExtentJob;
    class OpeningJob;

    /// When ranges were requested.
    struct Place {
        std::uint64_t round = 0;
        std::uint64_t generation = 0;  ///< of want()
    };
    /// Ranges of one want(); those before `next` have been requested.
    struct Hint {
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
    /// Calls check(), and records whether it threw.
    void check_whoever_waits() const;
    /// Throws what check() throws, and the error that made the object unreadable.
    void wait_until(Lock& lock, const std::function<bool()>& is_over) const;
    /// Whether the extent has its first `until` bytes: false if it was replaced by others.
    bool wait_for(Lock& lock, const ExtentPointer& extent, std::uint64_t until) const;
    /// All extents that have a part of the range; requests what is in none.
    std::vector<ExtentPointer> extents_for(Lock& lock, const ByteRange& range) const;
    void load_from_cache(const std::vector<ExtentPointer>& wanted) const;
    /// If the extent was prefetched and the cache has not been searched for it, loads it with its
    /// batch.
    void load_prefetched(Lock& lock, const ExtentPointer& extent) const;
    void end_extent(Extent& extent, Extent::State state,
                    std::shared_ptr<const Error> failure) const;
    static HeldBytes held(const std::vector<ExtentPointer>& extents, const ByteRange& range);
    // With the lock held:
    void ask_for_hints() const;
    [[nodiscard]] bool is_distrusted(const ByteRange& range) const;
    void ask(const std::vector<ByteRange>& absent, const Place& place, bool is_urgent) const;
    std::vector<ExtentPointer> hold_places(const std::vector<ByteRange>& absent, const Place& place,
                                           bool is_urgent) const;

    mutable FetchObject object_;
    bool has_query_;
    std::string query_;  ///< of ObjectState
    RemoteOptions options_;
    ObjectState state_;
    std::optional<ObjectState> known_;  ///< from an earlier opening
    std::string version_;  ///< may be a weak ETag or a time, which is not sufficient for a cache
    std::shared_ptr<RangeCache> cache_;
    bool is_open_ = false;

    mutable std::mutex mutex_;
    mutable std::condition_variable changed_;
    mutable Extents extents_;
    mutable std::deque<ExtentPointer> urgent_;
    mutable std::deque<ExtentPointer> hinted_;
    mutable std::deque<std::vector<ExtentPointer>> to_load_;  ///< prefetched; may be in cache_
    mutable std::deque<Hint> hints_;
    mutable std::deque<ByteRange> distrusted_;  ///< the cache may have wrong bytes of these ranges
    mutable std::shared_ptr<const Error> broken_;  ///< set when nothing can be read any more
    mutable bool is_closing_ = false;              ///< no more requests are made
    mutable std::uint64_t rounds_ = 0;
    mutable std::uint64_t generation_ = 0;
    mutable std::atomic<std::uint64_t> cache_bytes_{0};
    mutable std::atomic<bool> was_cancelled_{false};
    mutable std::shared_ptr<FetchJob> opening_;
    // Last, because their threads use the members above.
    mutable FetchLoop loop_;
    std::unique_ptr<Background> loading_;  ///< null: there is no cache
    std::unique_ptr<Background> keeping_;  ///< null: there is no cache
};

}  // namespace isonest::detail
