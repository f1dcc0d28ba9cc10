// A mesh in a volume's own axes, turned into the world's on its way to a sink.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <mutex>
#include <vector>

#include <isonest/extract_report.h>
#include <isonest/int3.h>
#include <isonest/mesh_sink.h>

namespace isonest::detail {

/// Positions are turned about a point, normals turned. All batches are asked for once more than the
/// inner sink does: the first time only their box, which its begin() is told, and their
/// areas are looked at.
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
    /// Most by which 32-bit floats round a position, in world units.
    [[nodiscard]] double rounding() const;
    /// Triangles that have no area once their corners are turned and rounded.
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
    std::mutex box_;  ///< of layout_'s box while it is measured
};

/// Turned positions are rounded once more: adds that to what the report of a mesh in the volume's
/// own axes says, and counts triangles without area anew. `spacing`: of the volume.
void report_turning(const RotatedSink& turning, const Double3& spacing, ExtractReport& report);

}  // namespace isonest::detail
