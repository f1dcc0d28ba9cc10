// What the surface in a slab is made from beside the values.
#pragma once

#include <isonest/int3.h>

namespace isonest::detail {

struct SlabPlace {
    double iso = 0;
    bool normals = false;
    Double3 spacing{1, 1, 1};
    Double3 origin{};
    double sight = 0;  ///< how near to a node a vertex may share its place with another one
};

}  // namespace isonest::detail
