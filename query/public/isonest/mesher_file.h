// Writes the interfaces of labels as input of programs that make tetrahedral meshes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/label_name.h>
#include <isonest/mesh_file.h>
#include <isonest/mesh_sink.h>

namespace isonest {

struct MesherFileOptions {
    /// As MeshFileOptions::replace; also for the second file.
    bool replace = false;
    MeshSpace space = MeshSpace::automatic;  ///< as MeshFileOptions::space
    std::optional<LengthUnit> unit = {};     ///< as MeshFileOptions::unit
    /// The labels to be filled with tetrahedra, with their names if they have some; ids of at most
    /// 2^53. All other labels, and the outside, are left empty.
    std::vector<LabelName> labels = {};
    /// Folder for temporary files; empty: the system's.
    std::filesystem::path scratch = {};
};

/// Whether the name is that of such a file: NAME.msh or NAME.smesh.
bool is_mesher_file(const std::filesystem::path& path);

/// Opens a sink for the mesh of extract_interfaces():
///
///   .msh    gmsh 4.1, binary, and beside it the script NAME.geo, from which `gmsh -3 NAME.geo`
///           makes tetrahedra. A physical surface for each pair of labels, numbered from 1 in
///           ascending order, and a physical volume for each of the labels, whose number is the
///           label or, unless all are between 1 and 2^31 - 1, its place in the list
///   .smesh  tetgen: `tetgen -pA NAME.smesh`. The markers of facets are the numbers of the pairs of
///           labels, which comments list; each connected part of a label has a point inside, with
///           the label as its attribute
///
/// Each connected part of a label is found from the mesh alone: triangles that follow each other
/// around an edge bound the same part, and a cavity belongs to the part that a line from it meets.
/// Points are half-way between two triangles that such a line meets one after the other.
///
/// Files appear under their names when the mesh ends. Data that grows with the mesh, at most 170
/// bytes per triangle, is kept in temporary files; heap grows with the number of parts. prepare()
/// throws Error{invalid_argument} as the sink of open_mesh_file(), for a mesh without labels on
/// both sides, and for one with attributes; end() throws Error{invalid_argument} if the surface of
/// a part is not closed, and Error{limit} for more than 2^20 parts. All throw Error{io}.
std::unique_ptr<MeshSink> open_mesher_file(const std::filesystem::path& path,
                                           const MesherFileOptions& options);

}  // namespace isonest
