// Which file keeps the analysis of a surface, and whether it is what it is to be.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "query/extract/extract_query.h"
#include "query/simplify/distance_ladder.h"
#include "store/container/analysis_file.h"

namespace isonest::detail {

enum class AnalysisState : std::uint8_t { none, current, stale, damaged };

struct FoundAnalysis {
    std::filesystem::path path;
    AnalysisState state = AnalysisState::none;
    std::unique_ptr<AnalysisFile> file;  ///< null if there is none, or where it is damaged
    std::string problem;                 ///< if it is stale or damaged
};

/// The analysis of the query's surface. REQUIRES: query.analysis_folder. Every byte was compared
/// with its checksum. Throws Error{io} (but not for what lies in the file).
FoundAnalysis find_analysis(const StoreReader& store, const ExtractQuery& query);

/// How much of an analysis is looked at.
enum class AnalysisDepth : std::uint8_t { attributes, bytes };

/// All of a store that lie in analysis_folder_of(store), by name. Throws Error{io}.
std::vector<FoundAnalysis> all_analyses(const StoreReader& store, AnalysisDepth depth);

/// Where the analyses of a store are if nobody says where: beside its file; of a store elsewhere,
/// in the current folder.
std::filesystem::path analysis_folder_of(const StoreReader& store);

/// The query that an analysis is of, for people.
std::string query_text(const AnalysisFile& analysis);

/// Whether the file can be written, before any work. Throws Error{io, not_found,
/// invalid_argument}.
void require_place(const std::filesystem::path& analysis, const StoreReader& store);

/// Writes the file; what was there under its name is replaced. `surface.key` is filled in. Throws
/// Error{io, invalid_argument} (something that is no file lies there).
void keep_analysis(const StoreReader& store, const ExtractQuery& query, AnalysedSurface surface,
                   const std::vector<LadderStep>& ladder);

/// A mesh of an analysis. REQUIRES: its bytes were compared. `layout`: without counts. Throws
/// Error{io}.
void load_step(const AnalysisFile& analysis, std::size_t step, MeshLayout layout,
               ScratchMesh& mesh);

}  // namespace isonest::detail
