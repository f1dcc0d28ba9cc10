// The stages that simplify.
#pragma once

#include <memory>
#include <string>

#include "query/extract/extract_query.h"
#include "query/extract/stages/stage.h"
#include "query/mesh/components.h"
#include "query/ranks/cube_shares.h"
#include "query/simplify/simplify_by_value.h"
#include "store/base/memory.h"
#include "store/container/reader.h"

namespace isonest::detail {

// Simplification within a distance, or to a number of triangles.

/// The limit at which simplification to a triangle budget starts.
double first_budget_limit(const MeshPlace& place);

/// Throws Error{limit}: the mesh with the fewest triangles found for the volume `name` has
/// `triangles`, more than `most`.
[[noreturn]] void refuse_budget(const std::string& name, std::uint64_t most,
                                std::uint64_t triangles, const ComponentSizes& sizes);

/// The number of threads for which there is memory for a simplification with the effort `best`.
/// Throws Error{limit} if there is none.
int distance_stage_threads(const MemoryShare& memory);

/// The stage for elements with `corners` corners: isolines, or a surface with the effort of the
/// choice. `fast` is by successive mappings alone; its blocks are shared by `team`, if given. Its
/// result has the distance. run() throws Error{limit} for a distance that float32 cannot represent,
/// and for a number of triangles that no distance gives. Throws Error{limit} if there is too little
/// memory. REQUIRES: choice.within > 0.
std::unique_ptr<Stage> distance_stage(int corners, const DistanceChoice& choice,
                                      const MemoryShare& memory, RankTeam* team);

// The stage that simplifies a surface within an error of the values.

/// The fraction of the error that the triangles of the nested grid may have before they are
/// simplified. With a smaller fraction there are more of them and it takes longer, but the result
/// has hardly fewer (figures in query/DISTANCE.md).
inline constexpr double kNestedShare = 0.75;

/// The fraction of the error at which the traversal stops: triangles with exact vertices have up to
/// twice the error of their tetrahedra.
constexpr double nested_share(VertexPlace vertices) {
    return vertices == VertexPlace::exact ? kNestedShare / 2 : kNestedShare;
}

/// Whether simplifying a surface within an error (in units of the data) costs less for hexahedra at
/// full resolution than for the nested grid of tetrahedra. This compares the size of the chunks of
/// values that only full resolution reads with that of the deviations and coarser values that only
/// the nested grid reads; hexahedra are cheaper if theirs is not larger. Estimated from the chunk
/// table level by level, starting with the coarsest, until it is decided: the result does not
/// depend on the location of the store, and for a remote store little is read that the nested grid
/// does not need. False for volumes with more than 2^15 chunks at level 1; true without the field
/// that the nested grid needs. Throws Error{corrupt, io}. REQUIRES: the store is of a volume in
/// three dimensions.
bool hexahedra_are_cheaper(const StoreReader& store, double iso, double error);

/// REQUIRES: the triangles are of tetrahedra within nested_share() of the error, or of hexahedra at
/// full resolution.
class ErrorStage : public Stage {
  public:
    /// The store must outlive it. `limit`: without numbers. `field`: bounds the values below a
    /// node. `traversal_heap`: of a thread of the traversal, which runs before. Throws Error{limit}
    /// if there is too little memory.
    ErrorStage(const StoreReader& store, ValueLimit limit, Field field,
               std::uint64_t traversal_heap, const MemoryShare& memory);
    /// Also throws Error{corrupt}.
    StageResult run(StageMesh& mesh, const StageTools& tools) override;

  private:
    const StoreReader& store_;
    ValueLimit limit_;
    Field field_;
    std::uint64_t each_;  ///< heap of a thread, besides the cache
    std::uint64_t memory_;
};

}  // namespace isonest::detail
