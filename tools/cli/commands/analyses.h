// What info and check say of the kept analyses of a store.
#pragma once

#include <string>

#include "query/extract/analysis/kept_analysis.h"
#include "tools/cli/command.h"

namespace isonest::detail::cli {

/// "current", "stale" or "damaged". REQUIRES: there is one.
const char* name_of(AnalysisState state);

/// File, query and state, with a line's end.
std::string analysis_line(const FoundAnalysis& found);
/// The same: "file", "query" (null where it is damaged), "state", "problem".
Json analysis_json(const FoundAnalysis& found);

}  // namespace isonest::detail::cli
