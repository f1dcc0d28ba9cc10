// Writes meshes to files.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include <isonest/int3.h>
#include <isonest/label_name.h>
#include <isonest/mesh_sink.h>

namespace isonest {

/// The frame of the positions and normals in a mesh file. Meshes in memory always use the frame of
/// the store or volume, given by MeshLayout::frame.
enum class MeshSpace : std::uint8_t {
    /// RAS if the frame is known, otherwise as stored. 3D Slicer reads files labelled RAS as RAS,
    /// and assumes LPS for others; niivue and FreeSurfer assume RAS for all files. (.ngmesh: as
    /// stored, because Neuroglancer shows the volume in its own coordinates.)
    automatic,
    as_stored,
    ras,  ///< prepare() of the sink throws Error{invalid_argument} if the frame is unknown
    lps   ///< likewise
};

/// Colours of vertices, from the value of one of their attributes.
struct VertexColors {
    std::string attribute = "value";
    double low = 0;   ///< value of the first colour; values below have it as well, and so has NaN
    double high = 1;  ///< value of the last colour; values above have it as well; > low
    std::array<LabelColor, 256> map{};  ///< evenly spaced; linear between them

    bool operator==(const VertexColors&) const = default;
};

/// The axis of the mesh's coordinates that points up in a file. Viewers of .glb and .obj expect y.
enum class UpAxis : std::uint8_t { z, y };

struct MeshFileOptions {
    /// Whether to replace an existing regular file, unless the mesh is made from it. Folders, links
    /// and devices are never replaced.
    bool replace = false;
    /// Name of the mesh, in UTF-8 without control characters; empty: none.
    std::string title = {};
    /// Colour in which the mesh is drawn.
    std::optional<LabelColor> color = {};
    MeshSpace space = MeshSpace::automatic;
    /// For .glb and .ply only: a colour for each vertex. prepare() throws Error{invalid_argument}
    /// for other formats, and if the mesh does not have the attribute.
    std::optional<VertexColors> colors = {};
    /// For .glb and .obj only; rejected for other formats. With y, (x, y, z) becomes (x, z, -y): by
    /// the node's rotation in .glb, in the coordinates in .obj.
    UpAxis up = UpAxis::z;
    /// The unit of length of the positions, if not that of the mesh, which must be known. Rejected
    /// for .glb, .3mf and .ngmesh, which have units of their own. Positions are multiplied before
    /// they are rounded to float32 once more.
    std::optional<LengthUnit> unit = {};
    /// For .ngmesh only: added to all positions, in world units (see VoxelOrigin). Rejected for
    /// other formats.
    Double3 shift = {};
};

/// Opens a sink that writes `path`. The extension (in upper or lower case) selects the format:
///
///   .ply     binary; values as float64 where needed
///   .stl     binary; triangles only, with repeated corners
///   .obj     text; normals; triangles or lines
///   .vtp     VTK XML, binary data in base64; everything; triangles or lines
///   .vtkhdf  VTKHDF; everything; triangles
///   .glb     glTF 2.0 binary; float32 only
///   .3mf     3MF; triangles only
///   .ngmesh  Neuroglancer's single-resolution mesh; triangles only
///
/// Elements with labels on both sides (MeshLayout::has_sides) can be written as .vtp and .vtkhdf
/// (cell array BoundaryLabels, two int64) and as .ply (face properties label_behind and
/// label_in_front, int32).
///
/// Colours of vertices are COLOR_0 in .glb, and red, green and blue in .ply.
///
/// Title and colour are written as the node's name and the material's colour in .glb, as the
/// object's name and display colour in .3mf, and as the field data "Name" and "Color" (0 to 1) in
/// .vtp; other formats do not store them.
///
/// Coordinates are float32. MeshLayout::unit is written if the format can store it. glTF uses
/// metres, ngmesh nanometres and 3MF one of six units: the mesh is scaled accordingly. If the unit
/// is unknown, the numbers are not changed; 3MF then interprets them as millimetres.
///
/// The frame of the positions, if known, is written in the way 3D Slicer reads it, SPACE=RAS or
/// SPACE=LPS: in the header text of .ply, .obj and .stl; in the field data "SPACE" of .vtp; as an
/// attribute SPACE of .vtkhdf; in the node's extras of .glb; and in the description of .3mf.
///
/// The file appears under its name only when the extraction ends, complete. Until then it has a
/// temporary name in the same folder; the sink's destructor removes it. A sink can be reused for
/// further extractions; each replaces the file only if the options allow it.
///
/// Throws Error{invalid_argument} for an unknown extension or an invalid title. prepare() throws
/// Error{invalid_argument} if the file may not be written or the format does not support lines or
/// labels, and Error{not_found} if the folder does not exist. begin() throws Error{limit} beyond
/// the largest numbers, labels included, that the format can store. All throw Error{io}.
std::unique_ptr<MeshSink> open_mesh_file(const std::filesystem::path& path,
                                         const MeshFileOptions& options = {});

}  // namespace isonest
