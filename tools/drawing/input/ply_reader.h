// Triangle meshes in binary PLY, read from a memory map, so they may be larger than memory.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>

#include <isonest/int3.h>

#include "store/files/open_file.h"

namespace isonest::detail::cli {

/// A binary little-endian PLY file of triangles: element vertex with float or double x, y, z among
/// properties of fixed size, then element face with one list (uchar count, int or uint indices)
/// among properties of fixed size. Comments, and elements after the faces, are ignored.
/// Thread-safety: const methods from any thread.
class PlyMesh {
  public:
    /// `value`: the name of the property that value() returns.
    /// Throws Error{not_found, io}, Error{corrupt} (not PLY, a damaged header, counts that do not
    /// match the file size) and Error{unsupported} (another kind of PLY), naming the file.
    explicit PlyMesh(const std::filesystem::path& path, const std::string& value = "value");
    /// For an open file; `path` is for messages.
    PlyMesh(int file, const std::filesystem::path& path, const std::string& value);

    [[nodiscard]] std::uint64_t vertices() const { return vertices_; }
    [[nodiscard]] std::uint64_t triangles() const { return triangles_; }
    /// REQUIRES: i < vertices(). Throws Error{corrupt} if a coordinate is not finite.
    [[nodiscard]] Double3 vertex(std::uint64_t i) const;
    /// Whether vertices have the requested property (float or double).
    [[nodiscard]] bool has_values() const { return value_offset_.has_value(); }
    /// The requested property; 0 if there is none. REQUIRES: i < vertices().
    [[nodiscard]] double value(std::uint64_t i) const;
    /// Whether vertices have 8-bit red, green and blue.
    [[nodiscard]] bool has_colors() const { return color_offset_.has_value(); }
    /// REQUIRES: has_colors(), i < vertices().
    [[nodiscard]] std::array<std::uint8_t, 3> color(std::uint64_t i) const;
    /// REQUIRES: i < triangles(). Throws Error{corrupt} if an index is out of range, and
    /// Error{unsupported} if the face is not a triangle.
    [[nodiscard]] std::array<std::uint32_t, 3> triangle(std::uint64_t i) const;

  private:
    void open(const std::string& value);
    struct Header;
    static Header parse(std::string_view text, const std::string& name, const std::string& value);

    std::string name_;
    MappedFile file_;
    std::uint64_t vertices_ = 0;
    std::uint64_t triangles_ = 0;
    std::uint64_t vertex_begin_ = 0;
    std::uint64_t face_begin_ = 0;
    std::uint64_t vertex_stride_ = 0;
    std::uint64_t face_stride_ = 0;
    std::array<std::uint64_t, 3> coordinate_offset_{};
    std::array<bool, 3> coordinate_is_double_{};
    std::optional<std::uint64_t> value_offset_;
    bool value_is_double_ = false;
    std::optional<std::array<std::uint64_t, 3>> color_offset_;
    std::uint64_t list_offset_ = 0;
    bool signed_indices_ = true;
};

}  // namespace isonest::detail::cli
