// Meshes as files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include <isonest/int3.h>
#include <isonest/label_name.h>
#include <isonest/mesh_sink.h>

namespace isonest {

/// In which frame a mesh file has its positions and normals. Meshes in memory always have those of
/// the store or the volume, and MeshLayout::frame says which those are.
enum class MeshSpace : std::uint8_t {
    /// RAS where the frame is known, else as stored. 3D Slicer reads files that say so as RAS, and
    /// takes others for LPS; niivue and FreeSurfer take all files for RAS. (.ngmesh: as stored, as
    /// Neuroglancer shows the volume beside it by its own numbers.)
    automatic,
    as_stored,
    ras,  ///< the sink's prepare() throws Error{invalid_argument} where the frame is unknown
    lps   ///< likewise
};

struct MeshFileOptions {
    /// Replace a regular file of that name, unless the mesh is made from it. Folders, links and
    /// devices are never replaced.
    bool replace = false;
    /// What the mesh is called, in UTF-8 without control characters; empty: nothing.
    std::string title = {};
    /// In which colour it is drawn.
    std::optional<LabelColor> color = {};
    MeshSpace space = MeshSpace::automatic;
    /// Of .ngmesh: is added to all positions, world units (see VoxelOrigin). Other formats refuse
    /// it.
    Double3 shift = {};
};

/// A sink that writes `path`, in the format that the name's end (in any case) chooses:
///
///   .ply     binary; values as float64 where they need it
///   .stl     binary; triangles alone, corners repeated
///   .obj     text; normals; triangles or lines
///   .vtp     VTK XML, binary data in base64; everything; triangles or lines
///   .vtkhdf  VTKHDF; everything; triangles
///   .glb     glTF 2.0 binary; float32 alone
///   .3mf     3MF; triangles alone
///   .ngmesh  Neuroglancer's single-resolution mesh; triangles alone
///
/// Elements with the labels on both sides (MeshLayout::has_sides) are written as .vtp and .vtkhdf,
/// which have them as the cells' array BoundaryLabels of two int64, and as .ply, as the faces'
/// properties label_behind and label_in_front, int32.
///
/// Title and colour are written as the node's name and the material's colour of .glb, the object's
/// name and display colour of .3mf, and the field data "Name" and "Color" (from 0 to 1) of .vtp;
/// the other formats have none. Coordinates are float32. MeshLayout::unit is written where the
/// format has a place for it; glTF is in metres and ngmesh in nanometres, 3MF in one of six units,
/// to which a mesh is scaled. Where it is not known, the numbers stay and 3MF takes them for
/// millimetres. The frame of the positions, where it is known, is written as 3D Slicer reads it,
/// SPACE=RAS or SPACE=LPS, in the header's text of .ply, .obj and .stl, and in the field data
/// "SPACE" of .vtp; as an attribute SPACE of .vtkhdf, in the extras of the node of .glb, and in the
/// description of .3mf. The file appears under its name when the extraction ends, whole or not at
/// all; until then it has a temporary name in the same folder, which the sink's destructor removes.
/// One sink may be used for one extraction after the other; each replaces the file only if the
/// options allow it. Throws Error{invalid_argument} for another end of the name, and for a title
/// that is no such text. The sink's prepare() throws Error{invalid_argument} if the file may not be
/// written or the format has no lines or no labels, and Error{not_found} without the folder;
/// begin() throws Error{limit} beyond what the format can number, labels too; all throw Error{io}.
std::unique_ptr<MeshSink> open_mesh_file(const std::filesystem::path& path,
                                         const MeshFileOptions& options = {});

}  // namespace isonest
