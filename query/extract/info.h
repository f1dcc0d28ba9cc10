// What a store holds.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "store/container/reader.h"

namespace isonest::detail {

struct ArrayReport {
    int level = 0;
    Field field = Field::values;
    Int3 nodes;
    Int3 chunk;
    std::uint64_t chunks = 0;
    std::uint64_t raw_bytes = 0;  ///< of the nodes themselves, without padding
    std::uint64_t stored_bytes = 0;
    double min = 0;  ///< of a store of 64-bit labels the label, rounded; of its indicators NaN
    double max = 0;
    /// Of the values of such a store, if a node has one: the smallest and the largest label.
    std::optional<std::array<std::int64_t, 2>> labels = {};
    bool alias = false;  ///< the same stored array as another field of the level
};

/// Sizes and ranges of all arrays, from the chunk table alone.
std::vector<ArrayReport> describe_arrays(const StoreReader& store);

/// Bytes of the ranges of all cubes.
std::uint64_t cube_range_bytes(const StoreReader& store);

}  // namespace isonest::detail
