// Reading bytes whose checksum is known.
#pragma once

#include <cstdint>
#include <optional>
#include <utility>

#include "store/base/checksum.h"
#include "store/bytes/store_bytes.h"

namespace isonest::detail {

/// Nothing if they are not those that were written. Of a store that is far, which may have them
/// wrong on the way, they are then fetched once more first. REQUIRES: the range lies within
/// bytes.size(). Throws Error{io}.
inline std::optional<HeldBytes> read_whole(const StoreBytes& bytes, const ByteRange& range,
                                           std::uint64_t xxh64) {
    HeldBytes held = bytes.read(range.offset, range.size);
    if (checksum_of(held.bytes()) != xxh64 && bytes.is_far()) {
        bytes.forget(range);
        held = bytes.read(range.offset, range.size);
    }
    return checksum_of(held.bytes()) == xxh64 ? std::optional(std::move(held)) : std::nullopt;
}

}  // namespace isonest::detail
