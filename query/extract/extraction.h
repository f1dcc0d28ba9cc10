// One extraction, from its parts to a mesh in the sink:
//
//     parts       -> welded mesh      query/mesh/weld.h
//     welded mesh -> stages in a row  query/extract/stages/stage_row.h
//     what is left -> sink
//
// Without a stage that has work, the welded parts go to the sink as they are. Contour lines are
// lines of a welded slice, and become parts once more.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "query/extract/find_parts.h"
#include "query/extract/stages/stage_row.h"
#include "query/mesh/weld.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

class Extraction {
  public:
    /// `volume`: where the parts are from. The sink and what follows must outlive the extraction.
    Extraction(StagedVolume volume, ExtractQuery asked, MeshSink& sink,
               const ExtractOptions& options, Progress& progress);

    /// Refuses what cannot be, before any work. `inputs`: files that are read.
    void prepare(std::vector<std::filesystem::path> inputs);
    /// Where the parts are to go; those beyond `memory` bytes to a temporary file.
    FoundParts begin_parts(std::uint64_t memory);
    /// From the parts, which are sealed, to the mesh in the sink.
    ExtractReport finish(const TraversalBudget& budget);
    /// The same of parts that stay on the ranks that made them, while the others call
    /// help_with_mesh().
    ExtractReport finish_on_ranks(const TraversalBudget& budget);
    [[nodiscard]] const ExtractQuery& asked() const { return asked_; }
    [[nodiscard]] const ScratchFolder& scratch() const { return scratch_; }

  private:
    [[nodiscard]] bool goes_straight() const;
    void begin_report();
    void emit(const PartStore& parts, const VertexNumbers& weld);
    void emit_contours(const VertexNumbers& weld, const TraversalBudget& budget);
    void run_stages(const std::vector<Stage*>& stages, std::shared_ptr<ScratchMesh> whole);
    void end_report();

    StagedVolume volume_;
    ExtractQuery asked_;
    MeshSink& sink_;
    const ExtractOptions& options_;
    Progress& progress_;
    ScratchFolder scratch_;
    MeshLayout layout_;
    ExtractReport report_;
    std::unique_ptr<StageRow> row_;
    std::optional<PartStore> parts_;
};

}  // namespace isonest::detail
