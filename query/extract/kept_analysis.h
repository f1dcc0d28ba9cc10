// Which file contains the analysis of a surface, and whether it is valid.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "query/extract/extract_query.h"
#include "query/simplify/triangle_budget.h"
#include "store/container/analysis_file.h"

namespace isonest::detail {

enum class AnalysisState : std::uint8_t { none, current, stale, damaged };

struct FoundAnalysis {
    std::filesystem::path path;
    AnalysisState state = AnalysisState::none;
    std::unique_ptr<AnalysisFile> file;  ///< null if there is none or it is damaged
    std::string problem;                 ///< why it is stale or damaged
};

/// Identifies the analysis that a query needs.
struct AnalysisName {
    std::filesystem::path path;
    std::string surface;  ///< everything that the meshes depend on, besides the store; see
                          ///< query_text()
};

/// REQUIRES: query.analysis_folder.
AnalysisName analysis_name(const StoreReader& store, const ExtractQuery& query);

/// The analysis of that name. Every byte was compared with its checksum. Throws Error{io} (but not
/// for the contents of the file).
FoundAnalysis find_analysis(const StoreReader& store, const AnalysisName& name);

/// How much of an analysis is read.
enum class AnalysisDepth : std::uint8_t { attributes, bytes };

/// All analyses of a store in analysis_folder_of(store), sorted by name. Throws Error{io}.
std::vector<FoundAnalysis> all_analyses(const StoreReader& store, AnalysisDepth depth);

/// The default folder of a store's analyses: that of its file; for a remote store, the current
/// folder.
std::filesystem::path analysis_folder_of(const StoreReader& store);

/// A readable description of the query of an analysis.
std::string query_text(const AnalysisFile& analysis);

/// Checks that the file can be written, before any work. Throws Error{io, not_found,
/// invalid_argument}.
void require_place(const std::filesystem::path& analysis, const StoreReader& store);

/// Writes the file and replaces an existing one. `surface.key` is filled in. Throws Error{io,
/// invalid_argument} (something that is not a file has that name).
void keep_analysis(const StoreReader& store, const AnalysisName& name, AnalysedSurface surface,
                   const std::vector<LadderStep>& ladder);

/// Loads a mesh of an analysis. REQUIRES: its bytes were verified. `layout`: without counts. Throws
/// Error{io}.
void load_step(const AnalysisFile& analysis, std::size_t step, MeshLayout layout,
               ScratchMesh& mesh);

// An extraction within a distance, from a kept analysis of its surface.

/// Like run_extraction() for a query with asked.analysis_folder and a distance: creates the
/// analysis if there is no current one, and makes the mesh from the analysis alone. Nothing if the
/// query is finer than its meshes; then nothing was passed to the sink.
std::optional<ExtractReport> extract_analysed(const StoreReader& store, const ExtractQuery& asked,
                                              MeshSink& sink, const ExtractOptions& options,
                                              Progress& progress);

}  // namespace isonest::detail
