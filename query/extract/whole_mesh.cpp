#include "query/extract/whole_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include <isonest/error.h>

#include "query/simplify/simplify_mesh.h"
#include "store/base/memory_budget.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

/// Most by which float32 moves a vertex, in world units.
double most_moved(const ExtractQuery& query) {
    const double longest = std::max({query.spacing[0], query.spacing[1], query.spacing[2]});
    return std::sqrt(3.0) * query.coordinate_rounding * longest;
}

/// What is left for the triangles.
double limit_of(const StoreReader& store, const ExtractQuery& query) {
    const double moved = most_moved(query);
    const double limit = *query.distance - moved;
    if (!(limit > 0)) {
        throw Error(ErrorKind::limit, {store.path().string()},
                    fmt::format("32-bit floats round coordinates so far from 0 by up to {:.3g}, "
                                "more than the distance {:.3g} allows",
                                moved, *query.distance));
    }
    return limit;
}

}  // namespace

bool changes_whole_mesh(const ExtractQuery& query) {
    return query.distance.value_or(0) > 0;
}

int whole_mesh_threads(const StoreReader& store, const ExtractQuery& /*query*/,
                       const ExtractOptions& options) {
    const std::uint64_t each = simplify_heap();
    require_memory(store.path().string(), options.memory, kLibraryHeap + each,
                   "simplification within a distance");
    return static_cast<int>(
        std::min((options.memory - kLibraryHeap) / each,
                 static_cast<std::uint64_t>(Workers::count_of(options.threads))));
}

void emit_whole_mesh(const StoreReader& store, const ExtractQuery& query, const ScratchMesh& mesh,
                     MeshSink& sink, const std::filesystem::path& scratch, ExtractReport& report,
                     Progress& progress) {
    report.full_triangles = mesh.layout().elements;
    report.scratch_bytes = mesh.bytes();
    const double limit = limit_of(store, query);
    const WorldLattice lattice{query.origin, query.spacing, store.layout().header().nodes};
    const SimplifiedMesh simplified(mesh, lattice, limit, scratch, progress);
    const EmittedMesh emitted = emit_elements(mesh, simplified.corners(), scratch, sink, progress);
    report.vertices = emitted.vertices;
    report.triangles = emitted.elements;
    report.zero_area_triangles = emitted.zero_area_triangles;
    report.distance_bound = simplified.bound() + most_moved(query);
    report.scratch_bytes += simplified.scratch_bytes();
}

}  // namespace isonest::detail
