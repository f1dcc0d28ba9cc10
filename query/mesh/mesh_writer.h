// Meshes as files, in the format that the file's name asks for.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include <isonest/progress.h>

#include "query/march/vertex_attributes.h"
#include "query/mesh/weld.h"

namespace isonest::detail {

enum class MeshFormat : std::uint8_t { ply, stl, obj, vtp, vtkhdf, glb };

/// By the end of the name: .ply .stl .obj .vtp .vtkhdf .glb, in any case.
/// Throws Error{invalid_argument} naming them.
MeshFormat mesh_format_of(const std::filesystem::path& path);

/// Whether the format has a place for values as float64.
bool holds_float64(MeshFormat format);

/// What the vertices of the parts carry, in order: "normal" (3 floats), "value", "error".
struct MeshContent {
    const PartStore& parts;
    const Weld& weld;
    AttributeChoice attributes;
    bool lines = false;  ///< "triangles" whose last two corners are equal: .vtp and .obj alone
};

/// Throws Error{invalid_argument} if the format cannot hold lines.
void require_lines(const std::filesystem::path& path);

/// Writes `path` whole: coordinates float32, triangles indexed (STL: repeated), attributes under
/// the format's own names where it has any (STL has none, OBJ only normals). Throws Error{limit}
/// beyond what the format can number, and Error{io, cancelled, invalid_argument}.
void write_mesh(const std::filesystem::path& path, bool force, const PartStore& parts,
                const Weld& weld, const AttributeChoice& attributes, bool lines,
                Progress& progress);

// One for each format, called by write_mesh().
void write_ply(const std::filesystem::path& path, bool force, const MeshContent& mesh,
               Progress& progress);
void write_stl(const std::filesystem::path& path, bool force, const MeshContent& mesh,
               Progress& progress);
void write_obj(const std::filesystem::path& path, bool force, const MeshContent& mesh,
               Progress& progress);
void write_vtp(const std::filesystem::path& path, bool force, const MeshContent& mesh,
               Progress& progress);
void write_vtkhdf(const std::filesystem::path& path, bool force, const MeshContent& mesh,
                  Progress& progress);
void write_glb(const std::filesystem::path& path, bool force, const MeshContent& mesh,
               Progress& progress);

/// Throws Error{limit} if the count ("vertices", say) is more than 32 bits can number.
void require_32_bits(const std::filesystem::path& path, std::uint64_t count, const char* what,
                     const char* format);

}  // namespace isonest::detail
