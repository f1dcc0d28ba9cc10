// Processing of a surface between the traversal and the sink, in addition to what its stop test
// implies.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include <isonest/world.h>

namespace isonest {

/// Which connected components of a surface are kept. Parts that share a vertex are connected. A
/// component must pass all tests; `largest` then selects among those that pass the others. This
/// happens before simplification: distances are measured from the surface without the dropped
/// components.
struct ComponentChoice {
    std::uint64_t largest = 0;        ///< keep only this many, those with the most triangles; 0 =
                                      ///< all. Ties: the one whose vertices come first
    std::uint64_t min_triangles = 0;  ///< minimum number of triangles (or lines), as extracted,
                                      ///< before simplification
    /// Minimum enclosed volume, above or below the isovalue, in cubic world units; >= 0. A
    /// component with a border (where the volume, the box or missing values cut it) has no volume
    /// and passes.
    double min_volume = 0;
};

/// Applied in this order: close, drop components, simplify according to the stop test, make a
/// manifold, pass to the sink.
struct SurfaceStages {
    /// Closes the surface with caps on the faces of the volume or of the box, so that every edge
    /// has two triangles. It stays open only at missing values. Caps are oriented like the surface:
    /// out of the solid with Outside::below, into it with Outside::above. Where nodes near those
    /// faces have exactly the isovalue, triangles without area arise; they are repaired. A
    /// hexahedron cut by the box is replaced by its smaller part, trilinear like the whole.
    /// Hexahedra are closed at full resolution, simplified or not.
    std::optional<Outside> close = {};
    /// Removes small components; without a value, components are not searched for.
    std::optional<ComponentChoice> components = {};
    /// Gives each sheet its own vertices where the surface touches itself in an edge or a vertex,
    /// so that every edge has at most two triangles and the triangles around every vertex are one
    /// fan. Vertices are copied, not moved: programs that join vertices by position undo it.
    /// Surfaces of values are manifold anyway. Takes at most 70 bytes of temporary space per
    /// triangle. Not for interfaces of labels, levels of detail and isolines.
    bool manifold = false;
};

/// An analysis of a surface, saved in its own file: meshes of the surface within distances from an
/// eighth of a voxel to four voxels. The first query creates the file, which takes several times as
/// long as the query alone. Further queries of the same surface, for any distance or triangle
/// budget, are answered from these meshes without reading the store. Their results have somewhat
/// more triangles than without the analysis. Distances below an eighth of a voxel do not use the
/// analysis. The file is recreated if the store has changed or the file is damaged.
struct KeptAnalysis {
    std::filesystem::path folder = {};  ///< empty: next to the store
};

}  // namespace isonest
