// The bytes of a store that a page's worker fetches for its queries.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <span>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "store/bytes/store_bytes.h"

namespace isonest::detail::web {

/// Thrown to unwind a query that cannot continue before the bytes of WebBytes::needed() are
/// provided. Not a std::exception, so that no handler treats it as an error of the query.
struct BytesAreMissing {};

/// How long fetching takes. Both in milliseconds.
struct WebTimes {
    /// Time since the start of this run of a query.
    std::function<double()> of_run;
    /// Time from a small request to its answer.
    double round_trip = 50;
};

/// Caches blocks of kBlock bytes within a budget. There are two ways to get what read() does not
/// find. Either it is fetched at once, one request after the other, while the query waits. Or the
/// query is unwound (BytesAreMissing), everything it has prefetched and requested is fetched
/// together, and the query runs again. It is unwound if that is cheaper: if the requests it saves
/// take longer than the query has run so far. Bytes that do not fit into the budget are never
/// waited for by unwinding, so every query ends. Not thread-safe: a worker has one thread.
class WebBytes : public StoreBytes {
  public:
    static constexpr std::size_t kBlock = std::size_t{8} << 10U;

    /// Fetches the bytes of a range at once; throws Error{io, corrupt}.
    using FetchNow = std::function<std::vector<std::byte>(const ByteRange& range)>;

    /// `budget`: maximum number of bytes held, at least 1 MiB.
    WebBytes(std::string name, std::uint64_t size, std::uint64_t budget, FetchNow fetch_now);

    [[nodiscard]] const std::string& name() const override { return name_; }
    [[nodiscard]] std::uint64_t size() const override { return size_; }
    [[nodiscard]] bool is_remote() const override { return true; }
    /// Throws BytesAreMissing, Error{io, corrupt}, and Error{limit} beyond the budget.
    [[nodiscard]] HeldBytes read(std::uint64_t offset, std::uint64_t size) const override;
    void want(std::span<const ByteRange> ranges) const override;
    void forget(const ByteRange& range) const override;
    [[nodiscard]] FetchedCounts fetched() const override { return counts_; }

    /// Starts another request, or the same one again. `may_unwind`: false if it must run to its
    /// end.
    void begin_run(bool may_unwind, const WebTimes& times);
    /// After BytesAreMissing: the ranges to provide, by offset, joined into few ranges.
    [[nodiscard]] std::vector<ByteRange> needed() const;
    /// Provides the bytes of a range of needed(), or of another range that begins at a block; a
    /// partial block at its end is kept only if it is the end of the object.
    void put(std::uint64_t offset, std::span<const std::byte> bytes) const;
    /// Bytes held.
    [[nodiscard]] std::uint64_t held() const { return blocks_.size() * kBlock; }
    /// Counts ranges that were fetched together as one round trip.
    void count_round_trip() { ++counts_.round_trips; }

  private:
    struct Block {
        std::unique_ptr<std::byte[]> bytes;
        std::list<std::uint64_t>::iterator use;
    };
    [[nodiscard]] std::size_t bytes_of_block(std::uint64_t number) const;
    /// Marks the block as most recently used; null if it is not cached.
    const std::byte* use_block(std::uint64_t number) const;
    void note(const ByteRange& range) const;
    /// Also fetches the requested blocks next to it. Throws what fetch_now_ throws.
    const std::byte* fetch_block(std::uint64_t number) const;
    void keep(std::uint64_t number, const std::byte* bytes) const;

    std::string name_;
    std::uint64_t size_;
    std::size_t max_blocks_;
    FetchNow fetch_now_;
    WebTimes times_;
    bool may_unwind_ = false;
    mutable std::unordered_map<std::uint64_t, Block> blocks_;
    mutable std::list<std::uint64_t> order_;  ///< least recently used first
    mutable std::unordered_set<std::uint64_t> noted_;
    mutable std::unordered_set<std::uint64_t> of_run_;  ///< blocks that this run has used
    mutable FetchedCounts counts_;
};

// The store that is open in a page's worker.

/// Sets what open_location() returns from now on, for any location.
void set_web_bytes(std::shared_ptr<WebBytes> bytes);

}  // namespace isonest::detail::web
