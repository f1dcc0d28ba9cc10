// What a distance that was asked for leaves for the triangles.
#pragma once

#include "query/extract/extract_query.h"
#include "query/extract/stages/stage.h"
#include "query/mesh/components.h"
#include "query/simplify/block_grid.h"
#include "query/simplify/patch.h"

namespace isonest::detail {

/// The least distance of neighbouring nodes, world units.
double voxel_of(const ExtractQuery& query);

/// Most by which float32 moves a vertex, in world units.
double most_moved(const ExtractQuery& query);

/// The distance asked for, without what float32 may take of it. REQUIRES: stages.distance. Throws
/// Error{limit} if nothing is left.
double limit_of(const StagedVolume& volume, const ExtractQuery& query);

/// The limit from which simplification goes on until there are few enough triangles.
double first_budget_limit(const ExtractQuery& query);

/// The same as limit_of() of query.nested_distance, whose triangles may be mended after they are
/// measured.
double nested_limit_of(const StagedVolume& volume, const ExtractQuery& query);

WorldLattice world_lattice(const StagedVolume& volume, const ExtractQuery& query);

/// A box between nodes, as vertices are: world coordinates, float32.
PatchBox rounded_box(const ExtractQuery& query, const ClipBox& box);

/// The box to which the surface is cut, as its vertices are.
PatchBox world_box(const ExtractQuery& query);

/// Counts and measures the surface that a distance is from.
void report_full(const StageMesh& mesh, ExtractReport& report);

/// Throws Error{limit}: the mesh with the fewest triangles that was found has these, more than
/// `most`.
[[noreturn]] void refuse_budget(const StagedVolume& volume, std::uint64_t most,
                                std::uint64_t triangles, const ComponentSizes& sizes);

/// Whether the query asks for a number of triangles at any distance.
bool any_distance(const StagedVolume& volume, const ExtractQuery& query);

}  // namespace isonest::detail
