// Joins the surfaces of slabs to one mesh.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include <isonest/extract_report.h>
#include <isonest/march.h>
#include <isonest/progress.h>

#include "query/march/mesh_part.h"
#include "query/mesh/measuring_sink.h"
#include "query/slabs/mend_slabs.h"
#include "query/slabs/slab_reader.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// A part of a slab's surface, ready for welding.

/// Maximum heap of a part per unit of its weight until it is stored: it exists up to three times,
/// vectors have spare room, and vertices at nodes have a table.
inline constexpr std::size_t kBytesPerPartWeight = 480;

/// The part with its vertices in the order of their first use by triangles. Attributes are the
/// normals, if any. REQUIRES: `shared` has the names.
MeshPart part_of(MarchedSlab&& slab);

/// Properties of a joined mesh.
struct JoinedMesh {
    std::uint64_t cells = 0;               ///< cells with triangles
    std::uint64_t without_normal = 0;      ///< number of vertices, if normals are requested
    MeshRoom room;                         ///< where the mesh is stored
    std::vector<std::uint32_t> not_alone;  ///< vertices that may be at the same place as others
    SurfaceSums sums;
    std::optional<AngleCounts> angles;  ///< if requested
    MendedTriangles mended;
    std::vector<std::uint32_t> moved;  ///< vertices moved by mending
};

/// Assigns one number to vertices shared by slabs, and joins the slabs to one mesh: triangles in
/// the order of the slabs, vertices in the order of their first use by triangles, so the result
/// does not depend on where slabs begin. Not thread-safe.
class SlabJoin {
  public:
    /// Adds the next slab, in ascending order.
    void append(MarchedSlab&& slab);
    /// Repairs triangles without area, writes the mesh into the memory from `make_room`, with all
    /// threads of the arena, and releases the slabs. Sets counts and box in the layout. `min_step`:
    /// see mend_triangles(). Throws Error{limit} beyond 2^32 - 1 vertices, Error{io, cancelled},
    /// and what `make_room` throws.
    JoinedMesh finish(MeshLayout& layout, const MakeRoom& make_room, const Double3& min_step,
                      bool with_angles, const ScratchFolder& folder, Progress& progress);

  private:
    /// A vertex that also belongs to the previous slab.
    struct Foreign {
        std::uint32_t vertex;
        std::uint32_t before;      ///< its number there
        std::uint32_t number = 0;  ///< in the mesh
    };
    /// A vertex that is the same as another one of the slab.
    struct Alias {
        std::uint32_t vertex;
        std::uint32_t same;
    };
    struct Part {
        MarchedSlab slab;
        std::vector<Foreign> foreign;
        std::vector<Alias> aliases;
        std::vector<std::uint32_t> number;  ///< for each vertex: among the slab's own, or in the
                                            ///< mesh
        std::vector<std::uint32_t> flat;    ///< triangles without area, ascending
        std::uint32_t own = 0;              ///< number of vertices that no earlier slab has
        std::uint64_t first_vertex = 0;     ///< in the mesh
        std::uint64_t first_triangle = 0;
        std::array<float, 3> lo{};
        std::array<float, 3> hi{};
        JoinedMesh found;
    };
    static void weld_edges(const Part& before, Part& part);
    static void weld_named(Part& before, Part& part);
    static void number_own(Part& part);
    static void number_in_mesh(Part& part);
    static NumberedSlab numbered(const Part& part);
    /// Writes the box of the mesh into the layout. With changes, only slabs that they affect are
    /// read again.
    void find_box(const MeshChanges* changes, MeshLayout& layout);
    static void put(Part& part, const MeshRoom& mesh, const MeshChanges& changes,
                    const SurfaceSums& none, bool with_angles);

    std::vector<Part> parts_;
};

// Final processing of a marched mesh as a whole, as done by the stages for the mesh of a store.

/// Properties of a settled mesh.
struct SettledMesh {
    // Maximum change of a coordinate, as a multiple of the distance between neighbouring nodes.
    double moved_by_mending = 0;
    double moved_apart = 0;
    std::uint64_t zero_area = 0;  ///< triangles
    ApartReport apart;
    SurfaceMeasures measures;
    std::optional<TriangleQuality> quality;  ///< if `joined` has angles
};

/// Separates vertices at the same place, and gives a normal to vertices without one. Throws
/// Error{io, cancelled}.
SettledMesh settle_mesh(const JoinedMesh& joined, const MeshLayout& layout,
                        const VolumeDescription& volume, const ScratchFolder& folder,
                        Progress& progress);

}  // namespace isonest::detail
