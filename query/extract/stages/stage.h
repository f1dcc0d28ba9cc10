// A stage: processing of the whole mesh of an extraction between the weld of its parts and the
// sink. query/extract/stages/pipeline.cpp determines which stages a query needs, and in which
// order.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <isonest/extract_report.h>
#include <isonest/progress.h>

#include "query/extract/extract_query.h"
#include "query/mesh/part_store.h"
#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The result of a stage. Fields that do not concern the stage stay empty.
struct StageResult {
    double moved = 0;  ///< maximum movement of a coordinate, as a multiple of the distance between
                       ///< neighbouring nodes
    double value_moved = 0;    ///< maximum change of a value or a graph's height, units of the data
    std::uint64_t mended = 0;  ///< triangles
    std::optional<ApartReport> apart = {};
    std::optional<ComponentReport> components = {};
    std::optional<std::uint64_t> border_vertices = {};
    std::optional<DistanceReport> distance = {};
    std::optional<bool> within_budget = {};
    std::optional<ErrorSimplificationReport> simplified_error = {};
    double error = 0;  ///< maximum error of the values on triangles that it made
};

/// Arguments of a stage, besides the mesh.
struct StageTools {
    const std::string& name;  ///< of the volume, for messages
    const MeshPlace& place;   ///< of the input mesh
    const ScratchFolder& scratch;
    Progress& progress;
};

/// The mesh between two stages: vertices in temporary files, and the remaining elements, which need
/// not use all of them.
class StageMesh {
  public:
    explicit StageMesh(std::shared_ptr<ScratchMesh> mesh)
        : vertices_(std::move(mesh)),
          elements_(vertices_->corners()),
          file_(&vertices_->changeable_corners()) {}

    [[nodiscard]] const ScratchMesh& vertices() const { return *vertices_; }
    [[nodiscard]] const CornerView& elements() const { return elements_; }

    /// Selects other elements with the same vertices; `owner` keeps their memory, `file`, if given,
    /// contains them. The previous elements are dropped.
    void choose(const CornerView& elements, std::shared_ptr<const void> owner,
                CornerFile* file = nullptr) {
        vertices_->changeable_corners().clear();
        elements_ = elements;
        owner_ = std::move(owner);
        file_ = file;
    }
    /// Declares that these elements will not be read any more, until others are chosen; call once
    /// per element.
    void consume(std::uint64_t first, std::uint64_t count) {
        if (file_ != nullptr) {
            file_->release(first, count);
        }
    }
    /// For a stage that adds vertices, to be used by its elements.
    [[nodiscard]] ScratchMesh& growing() { return *vertices_; }
    /// Replaces the whole mesh.
    void replace(std::shared_ptr<ScratchMesh> mesh) {
        elements_ = mesh->corners();
        owner_.reset();
        vertices_ = std::move(mesh);
        file_ = &vertices_->changeable_corners();
    }
    /// Calls f(ScratchMesh&), which changes vertices and elements in place. REQUIRES: no choose()
    /// before.
    template <class F>
    void change(F&& f) {
        f(*vertices_);
        elements_ = vertices_->corners();
    }

  private:
    std::shared_ptr<ScratchMesh> vertices_;
    CornerView elements_;
    CornerFile* file_;  ///< contains the elements, if known
    std::shared_ptr<const void> owner_;
};

/// Created before the traversal, run after it. Data that grows with the mesh is kept in temporary
/// files.
class Stage {
  public:
    /// `threads`: number of threads for which it has memory.
    explicit Stage(int threads) : threads_(threads) {}
    Stage(const Stage&) = delete;
    Stage& operator=(const Stage&) = delete;
    virtual ~Stage() = default;

    [[nodiscard]] int threads() const { return threads_; }
    /// Whether it has work for a mesh of these parts, from a volume with or without missing values.
    /// If no stage has work, the parts are passed directly to the sink.
    [[nodiscard]] virtual bool has_work(const PartStore& /*parts*/, bool /*has_missing*/) const {
        return true;
    }
    /// REQUIRES: called within an arena of at most threads(). Throws Error{io, cancelled}.
    virtual StageResult run(StageMesh& mesh, const StageTools& tools) = 0;

  private:
    int threads_;
};

}  // namespace isonest::detail
