#include "store/remote/join_ranges.h"

#include <algorithm>
#include <cstddef>

namespace isonest::detail {
namespace {

/// For each range but the first, whether the gap before it is bridged.
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

}  // namespace isonest::detail
