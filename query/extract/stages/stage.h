// A stage: what is done to the whole mesh of an extraction between the weld of its parts and the
// sink. Each stage is a class in a file of its own; query/extract/stages/stage_row.cpp says which
// of them a query needs, and in which order.
#pragma once

#include <memory>
#include <span>
#include <utility>

#include "query/extract/extract_query.h"
#include "query/extract/stages/staged_volume.h"
#include "query/mesh/part_store.h"
#include "query/mesh/scratch_mesh.h"
#include "store/base/workers.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// What all stages of one extraction see.
struct StageSetting {
    const StagedVolume& volume;
    ExtractQuery& query;  ///< what moves vertices adds to its coordinate_rounding
    const ExtractOptions& options;
    const ScratchFolder& scratch;  ///< the folder of temporary files
    Progress& progress;
};

/// The mesh between two stages: vertices in temporary files, and those elements that are left,
/// which need not name all of them.
class StageMesh {
  public:
    explicit StageMesh(std::shared_ptr<ScratchMesh> mesh)
        : vertices_(std::move(mesh)),
          elements_(vertices_->corners()),
          file_(&vertices_->changeable_corners()) {}

    [[nodiscard]] const ScratchMesh& vertices() const { return *vertices_; }
    [[nodiscard]] const CornerView& elements() const { return elements_; }

    /// Other elements of the same vertices; `owner` keeps their memory, `file`, if given, has them.
    /// Those that the mesh came with are gone.
    void choose(const CornerView& elements, std::shared_ptr<const void> owner,
                CornerFile* file = nullptr) {
        vertices_->changeable_corners().clear();
        elements_ = elements;
        owner_ = std::move(owner);
        file_ = file;
    }
    /// Nobody will look at these elements any more, each of which is consumed once, until others
    /// are chosen.
    void consume(std::uint64_t first, std::uint64_t count) {
        if (file_ != nullptr) {
            file_->release(first, count);
        }
    }
    /// For a stage that adds vertices, which its elements then have.
    [[nodiscard]] ScratchMesh& growing() { return *vertices_; }
    /// Another mesh, all of it.
    void replace(std::shared_ptr<ScratchMesh> mesh) {
        elements_ = mesh->corners();
        owner_.reset();
        vertices_ = std::move(mesh);
        file_ = &vertices_->changeable_corners();
    }
    /// f(ScratchMesh&) changes vertices and elements in place. REQUIRES: no choose() before.
    template <class F>
    void change(F&& f) {
        f(*vertices_);
        elements_ = vertices_->corners();
    }

  private:
    std::shared_ptr<ScratchMesh> vertices_;
    CornerView elements_;
    CornerFile* file_;  ///< that has the elements, if it is known
    std::shared_ptr<const void> owner_;
};

/// Made before the traversal, run after it. What grows with the mesh lies in temporary files.
class Stage {
  public:
    explicit Stage(const StageSetting& setting) : setting_(setting) {}
    Stage(const Stage&) = delete;
    Stage& operator=(const Stage&) = delete;
    virtual ~Stage() = default;

    /// For how many threads there is memory. Throws Error{limit} if there is for none.
    [[nodiscard]] virtual int threads() const {
        return Workers::count_of(setting_.options.threads);
    }
    /// Whether it has anything to do with a mesh of these parts. If no stage has, they go straight
    /// to the sink.
    [[nodiscard]] virtual bool has_work(const PartStore& /*parts*/) const { return true; }
    /// REQUIRES: is called within an arena of at most threads(). Throws Error{io, cancelled}.
    virtual void run(StageMesh& mesh, ExtractReport& report) = 0;

  protected:
    [[nodiscard]] const StageSetting& setting() const { return setting_; }

  private:
    StageSetting setting_;
};

}  // namespace isonest::detail
