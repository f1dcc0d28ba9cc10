// One extraction, from its parts to a mesh in the sink:
//
//     parts       -> welded mesh         query/mesh/weld.h
//     welded mesh -> stages in sequence  query/extract/stages/pipeline.h
//     final mesh  -> sink
//
// If no stage has work, the welded parts are passed directly to the sink. Contour lines are lines
// of a welded slice, and become parts again.
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <isonest/extract.h>

#include "query/extract/extract_query.h"
#include "query/extract/report.h"
#include "query/extract/stages/pipeline.h"
#include "query/mesh/part_store.h"
#include "query/mesh/weld.h"
#include "query/ranks/cube_shares.h"
#include "query/traverse/traversal.h"
#include "store/base/memory.h"
#include "store/container/reader.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// The surface with the smallest error that has at most a given number of triangles.

/// Like extract(). REQUIRES: query.stop is a TriangleBudgetByError. Throws Error{limit} if the
/// coarsest mesh has more triangles.
ExtractReport extract_within_triangle_budget(const Store& store, const SurfaceQuery& query,
                                             MeshSink& sink, const ExtractOptions& options,
                                             Progress& progress);

// From the query to parts: the traversal that a product needs.

/// Destination of the parts of one isovalue.
struct PartsPlace {
    double iso = 0;
    PartStore* parts = nullptr;
    /// On rank 0 of several, see settle_parts(); empty: parts of all ranks are sent to rank 0.
    std::function<bool()> may_stay = {};
};

/// Properties of the finished parts.
struct FoundParts {
    TraversalResult traversal;
    bool stay = false;  ///< parts stay on the ranks that made them
};

class PartsTraversal {
  public:
    /// For this many concurrent isovalues. Store and query must outlive it. Throws Error{limit} if
    /// there is too little memory.
    PartsTraversal(const StoreReader& store, const ExtractQuery& asked, const MemoryShare& memory,
                   std::uint64_t isovalues);
    [[nodiscard]] const TraversalBudget& budget() const { return budget_; }

    /// Fills and seals all parts in one traversal, then frees the additional memory. Chunks are
    /// counted separately for each part. REQUIRES: several isovalues only for a surface or isolines
    /// of values; called within an arena of budget().threads. `team`: ranks that share the
    /// traversal, or null; it is then collective: rank 0 receives the parts of all ranks, unless
    /// they stay on their ranks, and its result counts the work of all ranks. Throws what
    /// traverse() throws.
    std::vector<FoundParts> find(std::span<const PartsPlace> places, const ScratchFolder& scratch,
                                 Progress& progress, RankTeam* team) const;

  private:
    [[nodiscard]] std::vector<TraversalCounts> all_counts(
        ChunkCache& cache, const TraversalQuery& query, std::span<const PartsPlace> places,
        const ScratchFolder& scratch, const CurvedPlace* curved, Progress& progress) const;
    [[nodiscard]] double nested_limit() const;

    const StoreReader& store_;
    const ExtractQuery& asked_;
    TraversalBudget budget_;
};

/// The volume, as seen by an extraction.
struct ExtractedVolume {
    std::string name;    ///< for messages
    StoreHeader header;  ///< nodes, position and unit; nothing else for a volume without a store
    const StoreReader* store = nullptr;  ///< null: there is none

    ExtractedVolume(std::string name_, StoreHeader header_)
        : name(std::move(name_)), header(std::move(header_)) {}
    // NOLINTNEXTLINE(google-explicit-constructor,hicpp-explicit-conversions): where both are taken
    ExtractedVolume(const StoreReader& of)
        : name(of.path().string()), header(of.layout().header()), store(&of) {}
};

class Extraction {
  public:
    /// `volume`: source of the parts. The sink and the following arguments must outlive the
    /// extraction.
    Extraction(ExtractedVolume volume, ExtractQuery asked, MeshSink& sink,
               const ExtractOptions& options, Progress& progress);
    /// Memory from the options.
    [[nodiscard]] const MemoryShare& memory() const { return memory_; }

    /// Rejects impossible extractions, before any work. `inputs`: files that are read.
    void prepare(std::vector<std::filesystem::path> inputs);
    /// Creates the storage for parts; parts beyond `memory` bytes are kept in a temporary file.
    PartsPlace begin_parts(std::uint64_t memory);
    /// Processes the sealed parts to the mesh in the sink. If they stay on the ranks that made
    /// them, the other ranks meanwhile call help_with_mesh().
    ExtractReport finish(const FoundParts& found, const TraversalBudget& budget);
    [[nodiscard]] const ExtractQuery& asked() const { return asked_; }
    [[nodiscard]] const ScratchFolder& scratch() const { return scratch_; }

  private:
    [[nodiscard]] bool goes_straight() const;
    void make_on_ranks(ReportSum& report);
    /// Separates vertices of the parts, if that is still to be done.
    void keep_apart(const Weld& weld, ReportSum& report);
    void emit(const PartStore& parts, const VertexNumbers& weld, ReportSum& report);
    void emit_contours(const VertexNumbers& weld, const TraversalBudget& budget, ReportSum& report);
    void run_stages(const std::vector<Stage*>& stages, std::shared_ptr<ScratchMesh> whole,
                    ReportSum& report);

    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
    ExtractedVolume volume_;
    ExtractQuery asked_;
    MeshSink& sink_;
    MemoryShare memory_;
    RankTeam* team_;
    Progress& progress_;
    ScratchFolder scratch_;
    MeshLayout layout_;
    std::unique_ptr<Pipeline> pipeline_;
    std::optional<PartStore> parts_;
};

}  // namespace isonest::detail
