// What is done to a surface between the traversal and the sink, beside what its stop test implies.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include <isonest/world.h>

namespace isonest {

/// Which connected components of a surface are kept; two that share a vertex are one. All tests
/// have to be passed; `largest` chooses among those that pass the others. It happens before a
/// distance simplifies: what is measured from is the surface without those that are dropped.
struct ComponentChoice {
    std::uint64_t largest = 0;          ///< only so many, those with most triangles; 0 = all. Of
                                        ///< equally large ones those whose vertices come first
    std::uint64_t least_triangles = 0;  ///< (or lines) as extracted, before a simplification
    /// Of the space within, be it below or above the isovalue, in cubic world units; >= 0. A
    /// component with a border (where the volume, the box or missing values cut it) has no volume
    /// and passes.
    double least_volume = 0;
};

/// In this order: closed, components dropped, simplified as the stop says, handed to the sink.
struct SurfaceStages {
    /// Closes the surface by caps where it meets the faces of the volume or of the box, so that
    /// every edge has two triangles; only at missing values it stays open. The caps face as the
    /// surface does: out of the solid with Outside::below, into it with Outside::above. Where nodes
    /// near those faces have the isovalue exactly, triangles without area arise, and are mended. A
    /// hexahedron that the box cuts is the smaller one that is left, trilinear as the whole one is;
    /// hexahedra are closed at full resolution, simplified or not.
    std::optional<Outside> close = {};
    /// Drops specks; without a value components are not looked for.
    std::optional<ComponentChoice> components = {};
};

/// An analysis of a surface that is kept in a file of its own: meshes of it within distances from
/// an eighth of a voxel to four voxels. The first query that asks for one makes the file, which
/// takes several times as long as the query alone; others of the same surface, whatever their
/// distances and numbers of triangles, are made from these meshes and need the store no more. They
/// have somewhat more triangles than without; distances below an eighth of a voxel are made
/// without. The file is made anew where the store has changed, or where it is damaged.
struct KeptAnalysis {
    std::filesystem::path folder = {};  ///< empty: beside the store
};

}  // namespace isonest
