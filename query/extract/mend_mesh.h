// Triangles without area, before anything else is done to a whole mesh.
#pragma once

#include <filesystem>

#include "query/extract/extract_query.h"
#include "query/mesh/scratch_mesh.h"

namespace isonest::detail {

/// Mends the triangles of `mesh` (query/mesh/mend_triangles.h) and says so in the report. What
/// moves did to coordinates is counted as their rounding, in the report and in `query`. REQUIRES:
/// query.corners() == 3. Throws Error{io, cancelled}.
void mend_mesh(ExtractQuery& query, ScratchMesh& mesh, const std::filesystem::path& scratch,
               ExtractReport& report, Progress& progress);

}  // namespace isonest::detail
