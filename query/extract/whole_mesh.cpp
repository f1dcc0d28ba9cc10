#include "query/extract/whole_mesh.h"

#include <algorithm>
#include <optional>

#include "query/extract/distance_limits.h"
#include "query/extract/value_simplification.h"
#include "query/mesh/border_count.h"
#include "query/mesh/components.h"
#include "query/simplify/simplify_lines.h"
#include "query/simplify/triangle_budget.h"
#include "store/base/memory_budget.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

/// Of data in a plane.
int flat_axis(const Int3& nodes) {
    return nodes.x == 1 ? 0 : nodes.y == 1 ? 1 : 2;
}

BudgetResult simplified(const StoreReader& store, const ExtractQuery& query,
                        MeshSimplifier& simplifier, double limit) {
    if (!query.triangles) {
        return {simplifier.within(simplifier.full(), limit), limit, true};
    }
    BudgetResult result = within_budget(simplifier, *query.triangles, voxel_of(query) / 4, limit);
    if (!result.is_met && any_distance(store, query)) {
        refuse_budget(store, result.mesh.triangles);
    }
    return result;
}

}  // namespace

bool changes_whole_mesh(const ExtractQuery& query) {
    return simplifies(query) || query.value_limit || query.components;
}

int whole_mesh_threads(const StoreReader& store, const ExtractQuery& query,
                       const ExtractOptions& options) {
    if (query.value_limit) {
        return value_simplification_threads(store, query, options);
    }
    if (!simplifies(query)) {
        return Workers::count_of(options.threads);
    }
    const std::uint64_t each = query.corners() == 2 ? simplify_lines_heap() : simplify_heap();
    require_memory(store.path().string(), options.memory, kLibraryHeap + each,
                   "simplification within a distance");
    return static_cast<int>(
        std::min((options.memory - kLibraryHeap) / each,
                 static_cast<std::uint64_t>(Workers::count_of(options.threads))));
}

void emit_whole_mesh(const StoreReader& store, const ExtractQuery& query, const ScratchMesh& mesh,
                     MeshSink& sink, const ExtractOptions& options,
                     const std::filesystem::path& scratch, ExtractReport& report,
                     Progress& progress) {
    report.scratch_bytes += mesh.bytes();
    std::span<const ElementCorners> elements = mesh.corners();
    std::optional<KeptComponents> kept;
    if (query.components) {
        kept.emplace(mesh, *query.components, scratch, progress);
        elements = kept->corners();
        report.components = kept->components();
        report.dropped_components = kept->dropped();
        report.dropped_triangles = kept->dropped_elements();
        report.largest_dropped = kept->largest_dropped();
        report.scratch_bytes += kept->scratch_bytes();
    }
    std::optional<ScratchFile> corners;
    std::optional<SimplifiedLines> lines;
    if (simplifies(query) && query.corners() == 2) {
        lines.emplace(mesh, elements, flat_axis(store.layout().header().nodes),
                      limit_of(store, query), scratch, progress);
        elements = lines->corners();
        report.full_triangles = mesh.layout().elements;
        report.distance_bound = lines->bound() + most_moved(query);
        report.scratch_bytes += lines->scratch_bytes();
    } else if (simplifies(query)) {
        const double limit = limit_of(store, query);
        MeshSimplifier simplifier(mesh, elements, world_lattice(store, query), world_box(query),
                                  scratch, progress);
        const BudgetResult result = simplified(store, query, simplifier, limit);
        corners.emplace(simplifier.corners(result.mesh));
        elements = {corners->as<ElementCorners>().data(), result.mesh.triangles};
        report.full_triangles = mesh.layout().elements;
        report.distance_bound = result.mesh.bound + most_moved(query);
        report.scratch_bytes += simplifier.scratch_bytes();
        if (query.triangles) {
            report.within_budget = result.is_met;
            report.distance = result.limit + (result.limit > 0 ? most_moved(query) : 0);
        }
    }
    std::optional<SimplifiedByValue> by_value;
    if (query.value_limit) {
        by_value.emplace(
            simplify_by_value(store, query, mesh, elements, options, scratch, progress));
        elements = by_value->corners();
        report.nested_triangles = mesh.layout().elements;
        report.error_bound = std::max(report.error_bound, by_value->largest());
        report.scratch_bytes += by_value->scratch_bytes();
    }
    if (report.closed && store.has_missing()) {
        report.border_vertices = border_vertices(mesh, elements, scratch, progress);
    }
    const EmittedMesh emitted = emit_elements(mesh, elements, scratch, sink, progress);
    report.vertices = emitted.vertices;
    report.triangles = emitted.elements;
    report.zero_area_triangles = emitted.zero_area_triangles;
}

}  // namespace isonest::detail
