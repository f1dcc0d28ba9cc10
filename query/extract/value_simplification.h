// A surface that is simplified within an error of the values: its share of that error, its memory.
#pragma once

#include <filesystem>
#include <span>

#include "query/extract/extract_query.h"
#include "query/simplify/by_value/simplify_mesh_by_value.h"

namespace isonest::detail {

/// The part of the error that the triangles of the nested grid may have before they are simplified.
/// The smaller it is, the more of them there are, and the longer it takes; hardly fewer come out of
/// it (query/DISTANCE.md has figures).
inline constexpr double kNestedShare = 0.75;

/// The part of the error at which the traversal stops: triangles with exact vertices have up to
/// twice the error of their tetrahedra.
constexpr double nested_share(VertexPlace vertices) {
    return vertices == VertexPlace::exact ? kNestedShare / 2 : kNestedShare;
}

/// For how many threads there is memory. REQUIRES: query.value_limit. Throws Error{limit} if there
/// is for none.
int value_simplification_threads(const StoreReader& store, const ExtractQuery& query,
                                 const ExtractOptions& options);

/// REQUIRES: query.value_limit; `triangles` are of a traversal within kNestedShare of it; is called
/// within an arena of value_simplification_threads(). Throws Error{io, corrupt, cancelled}.
SimplifiedByValue simplify_by_value(const StoreReader& store, const ExtractQuery& query,
                                    const ScratchMesh& mesh,
                                    std::span<const ElementCorners> triangles,
                                    const ExtractOptions& options,
                                    const std::filesystem::path& scratch, Progress& progress);

}  // namespace isonest::detail
