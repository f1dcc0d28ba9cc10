// Numbers by which parts of a result are sorted, so that they do not depend on threads.
#pragma once

#include <cstdint>

#include <isonest/int3.h>

#include "query/view/morton.h"

namespace isonest::detail {

/// Sorts cubes, coarser levels first, those of a level by their Morton codes.
constexpr std::uint64_t cube_order(int level, std::uint64_t morton) {
    return static_cast<std::uint64_t>(63 - level) << 57U | morton;
}
/// Of the cube of edge 2^level whose low corner is node `low` of the finest lattice.
constexpr std::uint64_t cube_order(int level, const Int3& low) {
    return cube_order(level, morton_code({low.x >> level, low.y >> level, low.z >> level}));
}

}  // namespace isonest::detail
