// What is done to a mesh as a whole between the traversal and the sink.
#pragma once

#include <filesystem>

#include "query/extract/extract_query.h"
#include "query/mesh/scratch_mesh.h"

namespace isonest::detail {

/// Whether the query asks for anything of the kind.
bool changes_whole_mesh(const ExtractQuery& query);

/// For how many threads there is memory. Throws Error{limit} if there is for none.
int whole_mesh_threads(const StoreReader& store, const ExtractQuery& query,
                       const ExtractOptions& options);

/// Hands the mesh to the sink after what the query asks for. REQUIRES: is called within an arena of
/// whole_mesh_threads(). Throws Error{limit} (a distance that
/// float32 does not hold), Error{io, cancelled}, and what the sink throws.
void emit_whole_mesh(const StoreReader& store, const ExtractQuery& query, const ScratchMesh& mesh,
                     MeshSink& sink, const ExtractOptions& options,
                     const std::filesystem::path& scratch, ExtractReport& report,
                     Progress& progress);

}  // namespace isonest::detail
