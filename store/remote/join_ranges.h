// Which requests fetch a set of ranges.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "store/bytes/store_bytes.h"

namespace isonest::detail {

/// The first byte behind it.
inline std::uint64_t end_of(const ByteRange& range) {
    return range.offset + range.size;
}

struct JoinLimits {
    std::uint64_t gap = 16U << 10U;     ///< bytes between two ranges that a request may have beside
    std::uint64_t largest = 8U << 20U;  ///< bytes of one request
    /// Of all bytes that are fetched, at most one of so many is waste.
    std::uint64_t waste_part = 5;
};

struct JoinedRange {
    ByteRange range;
    std::uint64_t wanted = 0;  ///< bytes of it that were asked for
};

/// `ranges`: not empty, by offset, without overlap. `may_fetch`: whether a gap's bytes are neither
/// there nor under way. The smallest gaps are joined first, so the requests are as few as the waste
/// allows; ranges that touch are joined always, up to the largest request; larger ranges are cut
/// into equal pieces.
std::vector<JoinedRange> join_ranges(const std::vector<ByteRange>& ranges, const JoinLimits& limits,
                                     const std::function<bool(const ByteRange&)>& may_fetch);

}  // namespace isonest::detail
