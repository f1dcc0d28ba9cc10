// The mesh formats: each is a sink that writes a file.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <utility>

#include <isonest/mesh_file.h>

#include "store/files/output_file.h"

namespace isonest::detail {

/// Opens, publishes and drops the file; a format writes into file(). It is there from create() to
/// end().
class MeshFile : public MeshSink {
  public:
    MeshFile(std::filesystem::path path, MeshFileOptions options)
        : path_(std::move(path)), options_(std::move(options)) {}
    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override;
    void begin(const MeshLayout& layout) final;
    void end() override;

  protected:
    /// begin(), with the frame and the box that the mesh has in the file.
    virtual void begin_file(const MeshLayout& layout) = 0;
    /// Whether positions and normals that come are in the other frame than those in the file: x and
    /// y are then negated.
    [[nodiscard]] bool is_turned() const { return turned_; }
    [[nodiscard]] std::array<float, 3> in_file(const std::array<float, 3>& p) const {
        return turned_ ? std::array<float, 3>{0 - p[0], 0 - p[1], p[2]} : p;
    }
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// Empty: none.
    [[nodiscard]] const std::string& title() const { return options_.title; }
    [[nodiscard]] const std::optional<LabelColor>& color() const { return options_.color; }
    [[nodiscard]] const Double3& shift() const { return options_.shift; }
    /// Whether the format has lines.
    [[nodiscard]] virtual bool holds_lines() const { return false; }
    /// Whether it has the labels beside each triangle.
    [[nodiscard]] virtual bool holds_sides() const { return false; }
    /// `prepare`: as of OutputFile.
    OutputFile& create(
        const std::function<void(const std::filesystem::path& temporary)>& prepare = {});
    [[nodiscard]] OutputFile& file() { return *file_; }
    /// Throws Error{limit} if the count ("vertices", say) is not below 2^bits.
    void require_bits(unsigned bits, std::uint64_t count, const char* what,
                      const char* format) const;

  private:
    std::filesystem::path path_;
    MeshFileOptions options_;
    std::optional<OutputFile> file_;
    bool turned_ = false;
};

/// The frame of a mesh's positions in a file of this name. Throws Error{invalid_argument} for one
/// that is asked for where the volume's is unknown.
AnatomicalFrame frame_in_file(AnatomicalFrame frame, MeshSpace space,
                              const std::filesystem::path& path);

/// "SPACE=RAS": what 3D Slicer looks for. Empty where the frame is unknown.
std::string space_text(AnatomicalFrame frame);

std::unique_ptr<MeshSink> ply_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> stl_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> obj_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> vtp_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> vtkhdf_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> glb_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> threemf_file(const std::filesystem::path& path, const MeshFileOptions& o);
std::unique_ptr<MeshSink> ngmesh_file(const std::filesystem::path& path, const MeshFileOptions& o);

}  // namespace isonest::detail
