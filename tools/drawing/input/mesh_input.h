// Meshes in the other formats that isonest writes, for programs that read PLY: they are converted
// to an unnamed temporary file.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/progress.h>

#include "store/files/open_file.h"
#include "store/files/scratch_file.h"
#include "tools/drawing/input/ply_reader.h"

namespace isonest::detail::cli {

/// Takes vertices and triangles in any order and makes a binary PLY file of them.
class PlyScratch {
  public:
    /// `folder` is for temporary files; `name` is the mesh's, for messages. Throws Error{io}.
    PlyScratch(const std::filesystem::path& folder, std::string name);
    /// `value`: NaN if the mesh has no values; either all vertices have one or none. Throws
    /// Error{corrupt} for a coordinate that is not finite, Error{limit} beyond 2^32 vertices,
    /// Error{io}.
    void vertex(const std::array<double, 3>& position, double value);
    /// Corners are vertex indices, also of vertices that come later. Throws Error{corrupt, io}.
    void triangle(const std::array<std::uint64_t, 3>& corners);
    [[nodiscard]] std::uint64_t vertices() const { return vertices_; }
    [[nodiscard]] std::uint64_t triangles() const { return triangles_; }
    /// Completes the file. Throws Error{corrupt} for corners that are out of range, Error{io}.
    ScratchFile finish();

    /// Throws Error{corrupt} about the mesh being read.
    [[noreturn]] void fail(const std::string& problem) const;

  private:
    struct Rows {
        ScratchFile file;
        std::vector<std::byte> buffer = {};
        std::uint64_t written = 0;
        void add(std::span<const std::byte> row);
        void flush();
    };
    std::string name_;
    std::filesystem::path folder_;
    Rows vertex_rows_;
    Rows face_rows_;
    std::uint64_t vertices_ = 0;
    std::uint64_t triangles_ = 0;
    std::uint64_t largest_ = 0;
    bool has_values_ = false;
};

/// One reader per format. They throw Error{corrupt, unsupported, limit, io, cancelled}.
using MeshInput = void (*)(const std::filesystem::path& path, PlyScratch& to, Progress& progress);
void read_stl(const std::filesystem::path& path, PlyScratch& to, Progress& progress);
void read_ngmesh(const std::filesystem::path& path, PlyScratch& to, Progress& progress);
void read_obj(const std::filesystem::path& path, PlyScratch& to, Progress& progress);
void read_3mf(const std::filesystem::path& path, PlyScratch& to, Progress& progress);
void read_glb(const std::filesystem::path& path, PlyScratch& to, Progress& progress);
void read_vtp(const std::filesystem::path& path, PlyScratch& to, Progress& progress);
void read_vtkhdf(const std::filesystem::path& path, PlyScratch& to, Progress& progress);

/// Opens a mesh by its file name extension: .ply directly; .stl .obj .glb .3mf .vtp .vtkhdf .ngmesh
/// converted in `folder`, keeping only the vertex attribute "value". `value`: as for PlyMesh.
PlyMesh open_mesh(const std::filesystem::path& path, const std::string& value,
                  const std::filesystem::path& folder, Progress& progress);

/// A memory map of a file, with typed access. Throws Error{corrupt} beyond the end.
class MeshBytes {
  public:
    explicit MeshBytes(const std::filesystem::path& path) : file_(path), name_(path.string()) {}
    [[nodiscard]] std::uint64_t size() const { return file_.bytes().size(); }
    [[nodiscard]] const std::byte* at(std::uint64_t offset, std::uint64_t bytes) const;
    template <class T>
    [[nodiscard]] T number(std::uint64_t offset) const {
        T value{};
        std::memcpy(&value, at(offset, sizeof(T)), sizeof(T));
        return value;
    }
    [[noreturn]] void fail(const std::string& problem) const;

  private:
    MappedFile file_;
    std::string name_;
};

}  // namespace isonest::detail::cli
