#include "tools/web/web_bytes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

#include <isonest/error.h>

#include "store/remote/open_location.h"

namespace isonest::detail::web {
namespace {

/// Unrequested blocks between two requested ones that are fetched with them.
constexpr std::uint64_t kMaxGap = 2;
/// Maximum number of bytes in one request.
constexpr std::uint64_t kLargest = std::uint64_t{1} << 20U;

}  // namespace

WebBytes::WebBytes(std::string name, std::uint64_t size, std::uint64_t budget, FetchNow fetch_now)
    : name_(std::move(name)),
      size_(size),
      max_blocks_(static_cast<std::size_t>(
          std::max<std::uint64_t>(std::min(budget, size + kBlock) / kBlock, 8))),
      fetch_now_(std::move(fetch_now)) {}

std::size_t WebBytes::bytes_of_block(std::uint64_t number) const {
    return static_cast<std::size_t>(std::min<std::uint64_t>(kBlock, size_ - number * kBlock));
}

const std::byte* WebBytes::use_block(std::uint64_t number) const {
    const auto found = blocks_.find(number);
    if (found == blocks_.end()) {
        return nullptr;
    }
    order_.splice(order_.end(), order_, found->second.use);
    return found->second.bytes.get();
}

void WebBytes::keep(std::uint64_t number, const std::byte* bytes) const {
    noted_.erase(number);
    if (blocks_.contains(number)) {
        return;
    }
    std::unique_ptr<std::byte[]> room;
    if (blocks_.size() >= max_blocks_) {
        const auto oldest = blocks_.find(order_.front());
        room = std::move(oldest->second.bytes);
        blocks_.erase(oldest);
        order_.pop_front();
    } else {
        room = std::make_unique_for_overwrite<std::byte[]>(kBlock);
    }
    std::memcpy(room.get(), bytes, bytes_of_block(number));
    const auto use = order_.insert(order_.end(), number);
    blocks_[number] = {std::move(room), use};
}

void WebBytes::put(std::uint64_t offset, std::span<const std::byte> bytes) const {
    counts_.remote_bytes += bytes.size();
    ++counts_.requests;
    for (std::uint64_t number = offset / kBlock; number * kBlock < size_; ++number) {
        const std::uint64_t at = number * kBlock - offset;
        if (at + bytes_of_block(number) > bytes.size()) {
            return;
        }
        keep(number, bytes.data() + at);
    }
}

void WebBytes::note(const ByteRange& range) const {
    for (std::uint64_t number = range.offset / kBlock; number * kBlock < range.offset + range.size;
         ++number) {
        if (use_block(number) == nullptr) {
            noted_.insert(number);
        }
    }
}

void WebBytes::want(std::span<const ByteRange> ranges) const {
    for (const ByteRange& range : ranges) {
        if (range.size > 0 && lies_within(range.offset, range.size, size_) &&
            noted_.size() < max_blocks_ / 2) {
            note(range);
        }
    }
}

void WebBytes::forget(const ByteRange& range) const {
    for (std::uint64_t number = range.offset / kBlock; number * kBlock < range.offset + range.size;
         ++number) {
        if (const auto found = blocks_.find(number); found != blocks_.end()) {
            order_.erase(found->second.use);
            blocks_.erase(found);
        }
    }
}

void WebBytes::begin_run(bool may_unwind, const WebTimes& times) {
    may_unwind_ = may_unwind;
    times_ = times;
    noted_.clear();
    of_run_.clear();
}

std::vector<ByteRange> WebBytes::needed() const {
    std::vector<std::uint64_t> numbers(noted_.begin(), noted_.end());
    std::sort(numbers.begin(), numbers.end());
    const std::uint64_t largest =
        std::min<std::uint64_t>(kLargest, std::max<std::uint64_t>(max_blocks_ / 4, 1) * kBlock);
    std::vector<ByteRange> ranges;
    std::uint64_t next = 0;
    for (const std::uint64_t number : numbers) {
        const std::uint64_t end = number * kBlock + bytes_of_block(number);
        if (!ranges.empty() && number <= next + kMaxGap && end - ranges.back().offset <= largest) {
            ranges.back().size = end - ranges.back().offset;
        } else {
            ranges.push_back({number * kBlock, bytes_of_block(number)});
        }
        next = number + 1;
    }
    return ranges;
}

HeldBytes WebBytes::read(std::uint64_t offset, std::uint64_t size) const {
    if (size / kBlock + 2 > max_blocks_) {
        throw Error(
            ErrorKind::limit, {name_},
            fmt::format("{} contiguous bytes are needed, more than the memory for fetched data",
                        size),
            {{RemedyKind::more_memory}});
    }
    const std::uint64_t first = offset / kBlock;
    const std::uint64_t end = size == 0 ? first : (offset + size - 1) / kBlock + 1;
    bool is_there = true;
    for (std::uint64_t number = first; number < end; ++number) {
        of_run_.insert(number);
        is_there = use_block(number) != nullptr && is_there;
    }
    if (!is_there) {
        note({offset, size});
        const auto requests = static_cast<double>(needed().size());
        const bool fits = 4 * (of_run_.size() + noted_.size()) <= 3 * max_blocks_;
        if (may_unwind_ && fits && times_.of_run() < (requests - 1) * times_.round_trip) {
            throw BytesAreMissing();
        }
    }
    auto bytes = std::make_shared<std::vector<std::byte>>(static_cast<std::size_t>(size));
    for (std::uint64_t number = first; number < end; ++number) {
        const std::byte* block = use_block(number);
        if (block == nullptr) {
            block = fetch_block(number);
        }
        const std::uint64_t from = std::max(offset, number * kBlock);
        const std::uint64_t until = std::min(offset + size, (number + 1) * kBlock);
        std::memcpy(bytes->data() + (from - offset), block + (from - number * kBlock),
                    static_cast<std::size_t>(until - from));
    }
    return {bytes, *bytes};
}

const std::byte* WebBytes::fetch_block(std::uint64_t number) const {
    noted_.insert(number);
    for (const ByteRange& range : needed()) {
        if (range.offset <= number * kBlock && number * kBlock < range.offset + range.size) {
            put(range.offset, fetch_now_(range));
            ++counts_.round_trips;
        }
    }
    const std::byte* const block = use_block(number);
    if (block == nullptr) {
        throw Error(ErrorKind::io, {name_}, "fewer bytes were fetched than requested");
    }
    return block;
}

}  // namespace isonest::detail::web

namespace isonest::detail {
namespace web {

// In a page, a location is a URL that the page's worker reads.

namespace {

std::shared_ptr<WebBytes>& current() {
    static std::shared_ptr<WebBytes> bytes;
    return bytes;
}

}  // namespace

void set_web_bytes(std::shared_ptr<WebBytes> bytes) {
    current() = std::move(bytes);
}

}  // namespace web

std::shared_ptr<const StoreBytes> open_location(const std::filesystem::path& /*location*/,
                                                const RemoteAccess& /*remote*/,
                                                const std::shared_ptr<const DiskCache>& /*cache*/) {
    return web::current();
}

std::shared_ptr<const DiskCache> open_cache(const std::filesystem::path& /*location*/,
                                            const RemoteAccess& /*remote*/) {
    return nullptr;
}

std::string cache_warning(const DiskCache* /*cache*/) {
    return {};
}

}  // namespace isonest::detail
