// From the surfaces in slabs to one mesh.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include <isonest/march.h>

#include "query/mesh/measuring_sink.h"
#include "query/mesh/surface_sums.h"
#include "query/slabs/marched_slab.h"

namespace isonest::detail {

/// What is known of a joined mesh.
struct JoinedMesh {
    std::uint64_t cells = 0;  ///< that hold triangles
    std::uint64_t zero_area_triangles = 0;
    MeshRoom room;                         ///< that holds it
    std::vector<std::uint32_t> not_alone;  ///< vertices that may share their places with other ones
    SurfaceSums sums;
    std::optional<AngleCounts> angles;  ///< if asked for
};

/// Gives the vertices that slabs share one number, and puts the slabs into one mesh: its triangles
/// in the order of the slabs, its vertices in the order in which the triangles first name them, so
/// that nothing depends on where slabs begin. Not thread-safe.
class SlabJoin {
  public:
    /// The next slab, in ascending order.
    void append(MarchedSlab&& slab);
    /// Puts the mesh into the room that is made for it, with all threads of the arena, and lets go
    /// of the slabs. Writes counts and box into the layout. Throws Error{limit} beyond 2^32 - 1
    /// vertices, Error{cancelled}, and what `make_room` throws.
    JoinedMesh finish(MeshLayout& layout, const MakeRoom& make_room, bool with_angles,
                      Progress& progress);

  private:
    /// A vertex that is one of the slab before.
    struct Foreign {
        std::uint32_t vertex;
        std::uint32_t before;      ///< there
        std::uint32_t number = 0;  ///< in the mesh
    };
    /// A vertex that is another of the same slab.
    struct Alias {
        std::uint32_t vertex;
        std::uint32_t same;
    };
    struct Part {
        MarchedSlab slab;
        std::vector<Foreign> foreign;
        std::vector<Alias> aliases;
        std::vector<std::uint32_t> number;  ///< by vertex: among the slab's own, or in the mesh
        std::uint32_t own = 0;              ///< vertices that no earlier slab has
        std::uint64_t first_vertex = 0;     ///< in the mesh
        std::uint64_t first_triangle = 0;
        std::array<float, 3> lo{};
        std::array<float, 3> hi{};
        JoinedMesh found;
    };
    static void weld_edges(const Part& before, Part& part);
    static void weld_named(Part& before, Part& part);
    static void number_own(Part& part);
    static void put(Part& part, const MeshRoom& mesh, const SurfaceSums& none, bool with_angles);

    std::vector<Part> parts_;
};

}  // namespace isonest::detail
