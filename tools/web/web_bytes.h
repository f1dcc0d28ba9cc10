// The bytes of a store that a page's worker fetches for the queries that it runs.
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

/// Unwinds a query that cannot go on before WebBytes::needed() has been put there. No
/// std::exception: nobody takes it for an error of the query.
struct BytesAreMissing {};

/// How the bytes come. Both in milliseconds.
struct WebTimes {
    /// Of this run of a query, until now.
    std::function<double()> of_run;
    /// Of a small request, until its answer is there.
    double round_trip = 50;
};

/// Blocks of kBlock bytes within a budget. What read() does not find is either fetched at once, by
/// one request after the other, while the query waits; or the query is unwound (BytesAreMissing),
/// all that it has announced and asked for is fetched together, and it runs anew. It is unwound
/// where that costs less: where the requests that it spares take longer than what the query has
/// done until then. What does not fit into the budget is never waited for in that way, so every
/// query ends. Not thread-safe: a worker has one thread.
class WebBytes : public StoreBytes {
  public:
    static constexpr std::size_t kBlock = std::size_t{8} << 10U;

    /// The bytes of a range at once; throws Error{io, corrupt}.
    using FetchNow = std::function<std::vector<std::byte>(const ByteRange& range)>;

    /// `budget`: of bytes held, at least 1 MiB.
    WebBytes(std::string name, std::uint64_t size, std::uint64_t budget, FetchNow fetch_now);

    [[nodiscard]] const std::string& name() const override { return name_; }
    [[nodiscard]] std::uint64_t size() const override { return size_; }
    [[nodiscard]] bool is_far() const override { return true; }
    /// Throws BytesAreMissing, Error{io, corrupt}, and Error{limit} beyond the budget.
    [[nodiscard]] HeldBytes read(std::uint64_t offset, std::uint64_t size) const override;
    void want(std::span<const ByteRange> ranges) const override;
    void forget(const ByteRange& range) const override;
    [[nodiscard]] FetchedCounts fetched() const override { return counts_; }

    /// Another request, or the same again. `may_unwind`: false if it has to go on to its end.
    void begin_run(bool may_unwind, const WebTimes& times);
    /// After BytesAreMissing: what is to be put there, by offset, joined into few ranges.
    [[nodiscard]] std::vector<ByteRange> needed() const;
    /// The bytes of a range of needed(), or of any other that begins with a block; a part of a
    /// block at its end is kept only where the object ends.
    void put(std::uint64_t offset, std::span<const std::byte> bytes) const;
    /// Some ranges were fetched together.
    void count_round_trip() { ++counts_.round_trips; }

  private:
    struct Block {
        std::unique_ptr<std::byte[]> bytes;
        std::list<std::uint64_t>::iterator use;
    };
    [[nodiscard]] std::size_t bytes_of_block(std::uint64_t number) const;
    /// Moves the block to the end of the order of use; null if it is not there.
    const std::byte* use_block(std::uint64_t number) const;
    void note(const ByteRange& range) const;
    /// With what was noted next to it. Throws what fetch_now_ throws.
    const std::byte* fetch_block(std::uint64_t number) const;
    void keep(std::uint64_t number, const std::byte* bytes) const;

    std::string name_;
    std::uint64_t size_;
    std::size_t most_blocks_;
    FetchNow fetch_now_;
    WebTimes times_;
    bool may_unwind_ = false;
    mutable std::unordered_map<std::uint64_t, Block> blocks_;
    mutable std::list<std::uint64_t> order_;  ///< used last: at the end
    mutable std::unordered_set<std::uint64_t> noted_;
    mutable std::unordered_set<std::uint64_t> of_run_;  ///< blocks that this run has used
    mutable FetchedCounts counts_;
};

}  // namespace isonest::detail::web
