// Counts the edges and vertices where a mesh touches itself, or separates them, on its way to
// another sink.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include <isonest/extract_report.h>
#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

enum class TouchingSheets { counted, separated };

/// `counted`: passes everything on; `separated`: keeps the mesh in temporary files, which end()
/// passes on with copied vertices (query/apart/manifold.h). For meshes of triangles without sides.
/// Thread-safety: as the other sink's, or any.
class ManifoldSink : public MeshSink {
  public:
    static constexpr std::uint64_t kHeap = std::uint64_t{1} << 20U;  ///< maximum, bytes

    /// `sink` and `progress` must outlive it.
    ManifoldSink(MeshSink& sink, TouchingSheets what, ScratchFolder folder,
                 const Progress& progress);

    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override {
        sink_.prepare(layout, inputs);
    }
    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    [[nodiscard]] bool again() override;
    void end() override;
    [[nodiscard]] bool concurrent() const override { return separates() || sink_.concurrent(); }
    [[nodiscard]] bool holds_float64() const override { return sink_.holds_float64(); }

    /// Valid after end().
    [[nodiscard]] const ManifoldReport& report() const { return report_; }
    [[nodiscard]] std::uint64_t scratch_peak() const { return folder_.meter()->peak(); }

  private:
    [[nodiscard]] bool separates() const { return what_ == TouchingSheets::separated; }

    MeshSink& sink_;
    TouchingSheets what_;
    ScratchFolder folder_;
    const Progress& progress_;
    MeshLayout layout_;
    // If sheets are counted, one of these.
    std::vector<CornerView::Narrow> short_corners_;
    std::unique_ptr<CornerFile> corners_;
    std::unique_ptr<ScratchMesh> mesh_;  ///< if they are separated
    bool is_first_pass_ = true;
    ManifoldReport report_;
};

}  // namespace isonest::detail
