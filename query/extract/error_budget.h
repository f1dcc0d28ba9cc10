// The surface with the smallest error that has no more triangles than so many.
#pragma once

#include <isonest/extract.h>

namespace isonest::detail {

/// As extract(). REQUIRES: query.stop is an ErrorBudget. Throws Error{limit} if the coarsest mesh
/// has more triangles.
ExtractReport extract_within_error_budget(const Store& store, const SurfaceQuery& query,
                                          MeshSink& sink, const ExtractOptions& options,
                                          Progress& progress);

}  // namespace isonest::detail
