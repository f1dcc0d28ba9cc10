// Places the vertices of a part in the world, for a curvilinear grid.
#pragma once

#include <cstdint>
#include <optional>

#include <isonest/element.h>
#include <isonest/int3.h>

#include "query/march/clip.h"
#include "query/march/mesh_part.h"
#include "store/container/chunk_cache.h"
#include "store/container/format.h"

namespace isonest::detail {

/// How a part of a mesh is placed.
struct CurvedPlacing {
    /// On hexahedra, positions are trilinear between the nodes of a cell; on tetrahedra, linear
    /// between those of the finest tetrahedra. Both are linear along their edges.
    bool is_of_tetrahedra = false;
    /// The first three attributes are a normal: a unit vector along the gradient in the lattice.
    bool has_normals = false;
    /// The vertices less than this far from a node, world units, may be at the same place as
    /// others; nothing: it does not matter.
    std::optional<double> sight = {};
    /// The same for vertices near its faces, if it is closed; in the lattice.
    ClipBox box = {};
};

/// Thread-safety: const methods from any thread.
class CurvedPlace {
  public:
    /// Maximum number of chunks, each of three coordinates, that a thread holds.
    static constexpr std::size_t kMaxHeld = 4;

    /// `cache`: of a store with a curvilinear grid; it must outlive this object.
    CurvedPlace(ChunkCache& cache, const CurvedPlacing& placing)
        : cache_(cache), placing_(placing) {}

    /// Replaces the vertices' places in the lattice by those in the world, and turns the triangles
    /// over if the grid is mirrored. Normals are multiplied by the inverse transpose of the
    /// derivative, by central differences of the positions (one-sided at borders), linear like the
    /// positions; they become 0 where that is singular. The result is the same for any division
    /// into parts. REQUIRES: a part at full resolution, in the volume. Throws what the chunk source
    /// throws.
    void place(MeshPart& part) const;

  private:
    template <class T>
    void place_in(MeshPart& part) const;

    ChunkCache& cache_;
    CurvedPlacing placing_;
};

}  // namespace isonest::detail
