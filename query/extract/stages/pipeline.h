// The stages that a query needs, in order.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "query/apart/keep_apart.h"
#include "query/extract/stages/stage.h"
#include "query/ranks/cube_shares.h"
#include "store/base/memory.h"
#include "store/container/reader.h"

namespace isonest::detail {

// Separates vertices at the same place: in the parts of a mesh or, after it was mended, as a stage.

/// How they are separated, with the faces of the box to which a mesh is clipped.
ApartRange within_faces(ApartRange range, const MeshPlace& place);
/// `steps`: of the lattice.
StageResult apart_result(const ApartVertices& apart, const LatticeSteps& steps);

/// Used after fans were split and triangles mended; otherwise keep_apart.h does it.
class ApartStage : public Stage {
  public:
    /// `range`: without faces and box.
    ApartStage(int threads, ApartRange range) : Stage(threads), range_(std::move(range)) {}
    [[nodiscard]] bool has_work(const PartStore& parts, bool /*has_missing*/) const override {
        return parts.is_to_be_mended();
    }
    StageResult run(StageMesh& mesh, const StageTools& tools) override;

  private:
    ApartRange range_;
};

// Counts the open parts of a surface that was closed.

/// REQUIRES: a closed box. Without missing values there is nothing to count.
class BorderStage : public Stage {
  public:
    using Stage::Stage;
    [[nodiscard]] bool has_work(const PartStore& /*parts*/, bool has_missing) const override {
        return has_missing;
    }
    StageResult run(StageMesh& mesh, const StageTools& tools) override;
};

// Drops components.

/// REQUIRES: all vertices of the mesh are used by its elements.
class ComponentStage : public Stage {
  public:
    ComponentStage(int threads, const ComponentChoice& choice) : Stage(threads), choice_(choice) {}
    StageResult run(StageMesh& mesh, const StageTools& tools) override;

  private:
    ComponentChoice choice_;
};

// Gives each fan its own vertex where the box cut a sheet into several fans. It is the first stage
// of a whole mesh.

/// For surfaces (query/apart/split_fans.h).
class FanStage : public Stage {
  public:
    /// `box`: the traversal's box, which cuts sheets.
    FanStage(int threads, const ClipBox& box) : Stage(threads), box_(box) {}
    [[nodiscard]] bool has_work(const PartStore& parts, bool /*has_missing*/) const override {
        return parts.cut_fans() > 0;
    }
    StageResult run(StageMesh& mesh, const StageTools& tools) override;

  private:
    ClipBox box_;
};

// Mends triangles without area, after fans are split and before other stages.

/// For triangles (query/mesh/mend_triangles.h).
class MendStage : public Stage {
  public:
    /// `is_graph`: movement along z changes the displayed value.
    MendStage(int threads, bool is_graph) : Stage(threads), is_graph_(is_graph) {}
    [[nodiscard]] bool has_work(const PartStore& parts, bool /*has_missing*/) const override {
        return parts.zero_area_triangles() > 0;
    }
    StageResult run(StageMesh& mesh, const StageTools& tools) override;

  private:
    bool is_graph_;
};

class Pipeline {
  public:
    /// `store`: null for a volume without one. `team`: shares the blocks of a mesh, or null. Throws
    /// Error{limit} if there is too little memory for one of the stages.
    Pipeline(const ExtractQuery& query, const StoreReader* store, const MemoryShare& memory,
             RankTeam* team);

    /// The number of threads for which all stages have memory.
    [[nodiscard]] int threads() const { return threads_; }
    /// The stages that have work for a mesh of these parts. `has_missing`: values are missing in
    /// the volume. If there are none, the mesh need not be assembled. The stages live as long as
    /// the pipeline.
    [[nodiscard]] std::vector<Stage*> with_work(const PartStore& parts, bool has_missing) const;

  private:
    std::vector<std::unique_ptr<Stage>> stages_;
    int threads_;
};

}  // namespace isonest::detail
