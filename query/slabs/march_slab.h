// Marching the hexahedral cells of a slab of a volume that lies in memory.
#pragma once

#include <cstdint>

#include "query/slabs/marched_slab.h"
#include "query/slabs/slab_values.h"
#include "query/slabs/slab_vertices.h"

namespace isonest::detail {

/// The surface {U = iso} in the cells of `layers`: what march_finest_hexahedra() makes of them.
/// REQUIRES: the planes of the layers are there and, with normals, those beside them that the
/// volume has; no axis has one node alone.
template <class T>
MarchedSlab march_slab(const SlabValues<T>& values, const Slab& layers, const SlabPlace& place,
                       const SlabEstimate& likely);

/// Bytes of heap beside the slab.
std::uint64_t march_slab_bytes(const Int3& nodes);

}  // namespace isonest::detail
