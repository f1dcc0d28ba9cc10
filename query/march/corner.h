// A corner of an element that is marched.
#pragma once

#include <isonest/int3.h>

namespace isonest::detail {

struct Corner {
    Int3 node;     ///< of the lattice of LocalMesh::place(), else of the finest
    double value;  ///< REQUIRES: finite
};

}  // namespace isonest::detail
