// Sinks that process a mesh before another sink: rotation into the world's axes, and joining
// several meshes.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include <isonest/extract_report.h>
#include <isonest/int3.h>
#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "store/base/vectors.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// Rotates a mesh from a volume's own axes into the world's on its way to a sink.

/// Positions are rotated about a point; normals are rotated. All batches are requested once more
/// than the inner sink requests them: the first pass only determines their box, which is passed to
/// the inner begin(), and checks their areas.
class RotatedSink : public MeshSink {
  public:
    RotatedSink(MeshSink& inner, const Double3& about, const Directions& direction)
        : inner_(inner), about_(about), direction_(direction) {}

    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override {
        inner_.prepare(layout, inputs);
    }
    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool again() override;
    void end() override { inner_.end(); }
    [[nodiscard]] bool concurrent() const override { return inner_.concurrent(); }
    [[nodiscard]] bool holds_float64() const override { return inner_.holds_float64(); }
    /// Maximum rounding error of a position in 32-bit floats, in world units.
    [[nodiscard]] double rounding() const;
    /// Triangles without area after their corners were rotated and rounded.
    [[nodiscard]] std::uint64_t zero_area_triangles() const { return zero_area_; }

  private:
    struct Turned {
        std::vector<std::array<float, 3>> positions;
        std::vector<std::byte> attributes;
    };
    [[nodiscard]] Turned turned(const VertexBatch& batch) const;

    MeshSink& inner_;
    Double3 about_;
    Directions direction_;
    MeshLayout layout_;
    bool measured_ = false;  ///< the box and the triangles without area are known
    std::atomic<std::uint64_t> zero_area_ = 0;
    std::mutex box_;  ///< protects layout_'s box while it is measured
};

// Joins the meshes of several isovalues to one mesh.

/// Keeps a mesh for each isovalue in temporary files until all are complete, because the joined
/// mesh begins with the total counts.
class JoinedMeshes {
  public:
    /// REQUIRES: `sink` lives as long as this.
    JoinedMeshes(MeshSink& sink, std::span<const double> isovalues, ScratchFolder scratch);

    /// The sink for the mesh of isovalue number `i`. Its prepare() is that of the joined mesh. It
    /// must not outlive this object.
    [[nodiscard]] std::unique_ptr<MeshSink> part(std::size_t i);
    /// Outputs the meshes one after another, with the attribute "isovalue" after the attributes
    /// that they have. REQUIRES: all are complete. Throws Error{cancelled} and what the sink
    /// throws.
    void emit(Progress& progress);

  private:
    class Part;
    /// `layout` with the attribute.
    [[nodiscard]] MeshLayout with_isovalue(MeshLayout layout) const;

    MeshSink& sink_;
    std::vector<double> isovalues_;
    ScratchFolder scratch_;
    bool is_double_ = false;  ///< of the attribute
    std::vector<std::unique_ptr<ScratchMesh>> meshes_;
};

}  // namespace isonest::detail
