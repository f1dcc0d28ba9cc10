// Into which blocks the cells of a surface net are cut, and how many are worked on at a time.
#pragma once

#include <cstdint>
#include <string>

#include "query/surface_nets/net_block.h"

namespace isonest::detail {

/// What is made does not depend on it.
struct NetPlan {
    Int3 lo{};      ///< first cell that is worked on
    Int3 hi{};      ///< the cell behind the last
    Int3 block{};   ///< cells along each axis, a multiple of kPieceCells
    Int3 blocks{};  ///< along each axis
    int threads = 1;
    std::uint64_t cache = 0;  ///< bytes for decoded chunks that no block holds

    [[nodiscard]] Int3 first_cell(const Int3& number) const {
        return lo + Int3{number.x * block.x, number.y * block.y, number.z * block.z};
    }
};

/// Of the cells [lo, hi), which grow to whole pieces. `threads`: 0 = all cores; fewer run where
/// there is little memory. Larger blocks make less work twice, around them. `store`: its name.
/// Throws Error{limit} if there is too little memory.
NetPlan net_plan(const NetSetting& setting, const ArrayInfo& array, const Int3& lo, const Int3& hi,
                 std::uint64_t memory, int threads, const std::string& store);

}  // namespace isonest::detail
