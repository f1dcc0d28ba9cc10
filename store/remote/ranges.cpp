#include "store/remote/ranges.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <utility>

namespace isonest::detail {
namespace {

/// For each range except the first, whether the gap before it is bridged.
std::vector<bool> bridged_gaps(const std::vector<ByteRange>& ranges, const JoinLimits& limits,
                               const std::function<bool(const ByteRange&)>& may_fetch) {
    struct Gap {
        std::uint64_t size;
        std::size_t before;
    };
    std::vector<Gap> gaps;
    std::vector<bool> bridged(ranges.size(), false);
    std::uint64_t wanted = ranges.empty() ? 0 : ranges[0].size;
    for (std::size_t i = 1; i < ranges.size(); ++i) {
        wanted += ranges[i].size;
        const std::uint64_t from = end_of(ranges[i - 1]);
        const std::uint64_t size = ranges[i].offset - from;
        if (size <= limits.gap && (size == 0 || may_fetch({from, size}))) {
            gaps.push_back({size, i});
        }
    }
    std::sort(gaps.begin(), gaps.end(), [](const Gap& a, const Gap& b) {
        return a.size != b.size ? a.size < b.size : a.before < b.before;
    });
    std::uint64_t waste = 0;
    for (const Gap& gap : gaps) {
        if (limits.waste_part * (waste + gap.size) > wanted + waste + gap.size) {
            break;
        }
        waste += gap.size;
        bridged[gap.before] = true;
    }
    return bridged;
}

void append_pieces(const ByteRange& range, std::uint64_t largest, std::vector<JoinedRange>& out) {
    const std::uint64_t pieces = std::max<std::uint64_t>((range.size + largest - 1) / largest, 1);
    std::uint64_t done = 0;
    for (std::uint64_t i = 1; i <= pieces; ++i) {
        const std::uint64_t until = range.size / pieces * i + std::min(i, range.size % pieces);
        out.push_back({{range.offset + done, until - done}, until - done});
        done = until;
    }
}

}  // namespace

std::vector<JoinedRange> join_ranges(const std::vector<ByteRange>& ranges, const JoinLimits& limits,
                                     const std::function<bool(const ByteRange&)>& may_fetch) {
    const std::vector<bool> bridged = bridged_gaps(ranges, limits, may_fetch);
    std::vector<JoinedRange> out;
    for (std::size_t i = 0; i < ranges.size(); ++i) {
        const ByteRange& range = ranges[i];
        if (bridged[i] && end_of(range) - out.back().range.offset <= limits.largest) {
            out.back().range.size = end_of(range) - out.back().range.offset;
            out.back().wanted += range.size;
        } else {
            append_pieces(range, limits.largest, out);
        }
    }
    return out;
}

Extent::Extent(const ByteRange& of, std::shared_ptr<std::atomic<std::uint64_t>> alive)
    : range(of), alive_(std::move(alive)) {
    *alive_ += range.size;
}

Extent::~Extent() {
    if (alive_ != nullptr) {
        *alive_ -= range.size;
    }
}

void Extent::count_no_more() {
    *alive_ -= range.size;
    alive_ = nullptr;
}

std::vector<ByteRange> Extents::absent(const ByteRange& range) const {
    std::vector<ByteRange> out;
    const std::uint64_t end = range.offset + range.size;
    std::uint64_t at = range.offset;
    auto next = by_offset_.upper_bound(at);
    if (next != by_offset_.begin()) {
        const ByteRange& before = std::prev(next)->second->range;
        at = std::max(at, before.offset + before.size);
    }
    for (; at < end; ++next) {
        const std::uint64_t until = next == by_offset_.end() ? end : std::min(end, next->first);
        if (until > at) {
            out.push_back({at, until - at});
        }
        if (next == by_offset_.end()) {
            break;
        }
        at = next->first + next->second->range.size;
    }
    return out;
}

std::vector<std::shared_ptr<Extent>> Extents::use(const ByteRange& range) {
    std::vector<std::shared_ptr<Extent>> out;
    const std::uint64_t end = range.offset + range.size;
    auto next = by_offset_.upper_bound(range.offset);
    if (next != by_offset_.begin()) {
        --next;
    }
    for (; next != by_offset_.end() && next->first < end; ++next) {
        const std::shared_ptr<Extent>& extent = next->second;
        if (extent->range.offset + extent->range.size > range.offset) {
            by_use_.splice(by_use_.end(), by_use_, extent->place);
            out.push_back(extent);
        }
    }
    return out;
}

std::shared_ptr<Extent> Extents::insert(const ByteRange& range) {
    auto extent = std::make_shared<Extent>(range, alive_);
    by_offset_.emplace(range.offset, extent);
    extent->place = by_use_.insert(by_use_.end(), extent.get());
    return extent;
}

void Extents::erase(Extent& extent) {
    const auto found = by_offset_.find(extent.range.offset);
    if (found != by_offset_.end() && found->second.get() == &extent) {
        by_use_.erase(extent.place);
        by_offset_.erase(found);
    }
}

/// Drops extents that have been read first, then others that may be dropped.
template <class MayDrop>
bool Extents::drop_until_fits(std::uint64_t bytes, const MayDrop& may_drop) {
    return drop_those(bytes, [](const Extent& extent) { return extent.unread == 0; }) ||
           drop_those(bytes, may_drop);
}

template <class MayDrop>
bool Extents::drop_those(std::uint64_t bytes, const MayDrop& may_drop) {
    for (auto next = by_use_.begin(); next != by_use_.end() && alive() + bytes > budget_;) {
        Extent& extent = **next;
        ++next;
        // Only the map holds it, and nobody can start to hold it while the owner's lock is held.
        const bool is_held = by_offset_.at(extent.range.offset).use_count() > 1;
        if (extent.state == Extent::State::present && !is_held && may_drop(extent)) {
            erase(extent);
        }
    }
    return alive() + bytes <= budget_;
}

bool Extents::make_room(std::uint64_t bytes) {
    return drop_until_fits(bytes, [](const Extent&) { return true; });
}

bool Extents::make_room_for_hint(std::uint64_t bytes, std::uint64_t generation) {
    return drop_until_fits(
        bytes, [generation](const Extent& extent) { return extent.generation + 1 < generation; });
}

}  // namespace isonest::detail
