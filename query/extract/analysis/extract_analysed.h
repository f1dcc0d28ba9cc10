// An extraction within a distance from a kept analysis of its surface.
#pragma once

#include <optional>

#include "query/extract/extract_query.h"

namespace isonest::detail {

/// As run_extraction() of a query with asked.analysis_folder and a distance: makes the analysis if
/// there is none that is current, and the mesh from it alone. Nothing if what is asked for is finer
/// than its meshes; then nothing was handed to the sink.
std::optional<ExtractReport> extract_analysed(const StoreReader& store, const ExtractQuery& asked,
                                              MeshSink& sink, const ExtractOptions& options,
                                              Progress& progress);

}  // namespace isonest::detail
