// What UrlBytes asks for: what was announced, as far as it fits into the budget, and what somebody
// waits for.
#include <algorithm>
#include <cstddef>
#include <exception>
#include <optional>
#include <utility>

#include "store/remote/join_ranges.h"
#include "store/remote/url_bytes.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kMostAnnouncements = 8;
constexpr JoinLimits kJoinLimits{};

/// Without what lies outside, by offset, and without overlap; ranges that only touch stay apart.
std::vector<ByteRange> tidied(std::span<const ByteRange> ranges, std::uint64_t size) {
    std::vector<ByteRange> sorted;
    for (const ByteRange& range : ranges) {
        if (range.offset < size && range.size > 0) {
            sorted.push_back({range.offset, std::min(range.size, size - range.offset)});
        }
    }
    std::sort(sorted.begin(), sorted.end(),
              [](const ByteRange& a, const ByteRange& b) { return a.offset < b.offset; });
    std::vector<ByteRange> out;
    for (const ByteRange& range : sorted) {
        if (!out.empty() && range.offset < end_of(out.back())) {
            out.back().size = std::max(end_of(out.back()), end_of(range)) - out.back().offset;
        } else {
            out.push_back(range);
        }
    }
    return out;
}

}  // namespace

void UrlBytes::want(std::span<const ByteRange> ranges) const {
    Announced announced;
    announced.ranges = tidied(ranges, state_.size);
    const Lock lock(mutex_);
    if (broken_ != nullptr || announced.ranges.empty()) {
        return;
    }
    announced.place = {rounds_ + 1, ++generation_};
    announced_.push_back(std::move(announced));
    if (announced_.size() > kMostAnnouncements) {
        announced_.pop_front();
    }
    ask_for_announced();
}

void UrlBytes::ask_for_announced() const {
    while (!announced_.empty() && !is_closing_) {
        Announced& announced = announced_.front();
        std::vector<ByteRange> batch;
        std::uint64_t bytes = 0;
        bool fits = true;
        for (; announced.next < announced.ranges.size() && fits; ++announced.next) {
            const ByteRange& range = announced.ranges[announced.next];
            const std::vector<ByteRange> absent = extents_.absent(range);
            // With the largest waste of joined requests.
            const std::uint64_t more = bytes + range.size + range.size / 4;
            if (absent.empty() || range.size > options_.budget_bytes / 2) {
                continue;
            }
            if (!extents_.make_room_for_hint(more, announced.place.generation)) {
                fits = false;
                break;
            }
            bytes = more;
            batch.insert(batch.end(), absent.begin(), absent.end());
        }
        if (!batch.empty() && cache_ != nullptr) {
            to_load_.push_back(hold_places(batch, announced.place, false));
            loading_->add(0, [this] { load_next_batch(); });
        } else if (!batch.empty()) {
            ask(batch, announced.place, false);
        }
        if (!fits) {
            return;
        }
        announced_.pop_front();
    }
}

void UrlBytes::ask(const std::vector<ByteRange>& absent, const Place& place, bool is_urgent) const {
    const auto is_absent = [this](const ByteRange& gap) {
        const std::vector<ByteRange> parts = extents_.absent(gap);
        return parts.size() == 1 && parts[0].size == gap.size;
    };
    for (const JoinedRange& joined : join_ranges(absent, kJoinLimits, is_absent)) {
        extents_.make_room(joined.range.size);
        ExtentPointer extent = extents_.insert(joined.range);
        extent->unread = joined.wanted;
        extent->round = place.round;
        extent->generation = place.generation;
        extent->is_urgent = is_urgent;
        (is_urgent ? urgent_ : hinted_).push_back(std::move(extent));
    }
    loop_.wake();
}

std::vector<UrlBytes::ExtentPointer> UrlBytes::hold_places(const std::vector<ByteRange>& absent,
                                                           const Place& place,
                                                           bool is_urgent) const {
    std::vector<ExtentPointer> out;
    for (const ByteRange& range : absent) {
        extents_.make_room(range.size);
        out.push_back(extents_.insert(range));
        out.back()->unread = range.size;
        out.back()->round = place.round;
        out.back()->generation = place.generation;
        out.back()->is_urgent = is_urgent;
        out.back()->is_started = true;
    }
    return out;
}

/// Whatever fails here, no place is left that somebody may wait for and nobody fills.
void UrlBytes::load_from_cache(const std::vector<ExtentPointer>& wanted) const {
    for (const ExtentPointer& extent : wanted) {
        std::optional<std::vector<std::byte>> bytes;
        try {
            Lock lock(mutex_);
            const bool may_be_wrong = is_distrusted(extent->range);
            lock.unlock();
            if (!may_be_wrong) {
                bytes = cache_->load(extent->range);
            }
        } catch (const std::exception&) {
            bytes.reset();  // as where the cache has none
        }
        if (!bytes || bytes->size() != extent->range.size) {
            continue;
        }
        cache_bytes_ += bytes->size();
        const Lock lock(mutex_);
        extent->bytes = std::move(*bytes);
        extent->received = extent->range.size;
        extent->round = 0;
        extent->state = Extent::State::present;
        changed_.notify_all();
    }
    const Lock lock(mutex_);
    Place place;
    bool is_urgent = false;
    std::size_t missing = 0;
    for (const ExtentPointer& extent : wanted) {
        if (extent->state == Extent::State::coming) {
            place = {extent->round, extent->generation};
            is_urgent = is_urgent || extent->is_urgent;
            ++missing;
            extent->state = Extent::State::replaced;
            extents_.erase(*extent);
            extent->count_no_more();  // before there is made room for what replaces it
        }
    }
    if (missing == 0) {
        return;
    }
    changed_.notify_all();
    std::vector<ByteRange> absent;
    absent.reserve(missing);
    for (const ExtentPointer& extent : wanted) {
        if (extent->state == Extent::State::replaced) {
            absent.push_back(extent->range);
        }
    }
    ask(absent, place, is_urgent);
}

}  // namespace isonest::detail
