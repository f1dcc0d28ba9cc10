// Marching the hexahedral cells of a slab of a volume that lies in memory.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include <isonest/value_type.h>

#include "query/slabs/marched_slab.h"
#include "query/slabs/slab_place.h"
#include "query/slabs/slab_reader.h"

namespace isonest::detail {

/// The surface {U = iso} in slabs of one volume: what march_finest_hexahedra() makes of them. Its
/// tables are made once, and serve slab after slab. Not thread-safe.
class SlabMarcher {
  public:
    SlabMarcher() = default;
    SlabMarcher(const SlabMarcher&) = delete;
    SlabMarcher& operator=(const SlabMarcher&) = delete;
    virtual ~SlabMarcher() = default;

    /// The surface in the cells of `layers`. REQUIRES: the planes of the layers are there and, with
    /// normals, those beside them that the volume has.
    virtual MarchedSlab march(const SlabPlanes& planes, const Slab& layers,
                              const SlabEstimate& likely) = 0;
    /// The same in parts, whose `shared` names what others may have as well: each ends with the
    /// row of cells in which its weight (SlabVertices) reaches `most`. Calls part(number, surface);
    /// numbers ascend through all slabs of the volume.
    virtual void march_parts(const SlabPlanes& planes, const Slab& layers, std::size_t most,
                             const std::function<void(std::uint64_t, MarchedSlab&&)>& part) = 0;
};

/// Null if no values of the type can be on both sides: then there is no surface. REQUIRES: no axis
/// has one node alone.
std::unique_ptr<SlabMarcher> make_slab_marcher(ValueType type, const Int3& nodes,
                                               const SlabPlace& place);

/// Bytes of heap of a marcher beside the slab.
std::uint64_t march_slab_bytes(const Int3& nodes);

}  // namespace isonest::detail
