// Checksums of parts of a store's header: FORMAT.md, section 2. Private to the store.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "store/container/format.h"

namespace isonest::detail {

/// The attributes that the header's `xxh64` covers, in this order.
inline constexpr std::array<const char*, 12> kDigested{
    "version", "flags",       "nodes", "spacing", "origin", "value_type",
    "chunk",   "compression", "exact", "fields",  "range",  "has_missing"};

/// The three vectors one after the other.
std::vector<double> flat_directions(const Directions& direction);

/// XXH64 of the nine numbers, as the attribute `direction` has them.
std::uint64_t direction_digest(const Directions& direction);

/// XXH64 of an attribute of text (`unit`, `frame`) as it is stored.
std::uint64_t text_digest(std::string_view text);

}  // namespace isonest::detail
