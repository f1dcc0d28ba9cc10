#include "tools/cli/commands/analyses.h"

#include <fmt/format.h>

namespace isonest::detail::cli {

const char* name_of(AnalysisState state) {
    switch (state) {
        case AnalysisState::stale:
            return "stale";
        case AnalysisState::damaged:
            return "damaged";
        default:
            return "current";
    }
}

std::string analysis_line(const FoundAnalysis& found) {
    std::string line = found.path.string();
    if (found.file) {
        line += ": " + query_text(*found.file);
    }
    if (!found.problem.empty()) {
        line += fmt::format(": {}, {}; the next extraction that uses it makes it anew",
                            name_of(found.state), found.problem);
    }
    return line + "\n";
}

Json analysis_json(const FoundAnalysis& found) {
    return {{"file", found.path.string()},
            {"query", found.file ? Json(query_text(*found.file)) : Json()},
            {"state", name_of(found.state)},
            {"problem", found.problem.empty() ? Json() : Json(found.problem)}};
}

}  // namespace isonest::detail::cli
