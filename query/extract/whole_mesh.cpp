#include "query/extract/whole_mesh.h"

#include <algorithm>
#include <memory>
#include <optional>

#include "query/extract/distance_limits.h"
#include "query/extract/value_simplification.h"
#include "query/mesh/border_count.h"
#include "query/mesh/components.h"
#include "query/simplify/lines/simplify_lines.h"
#include "query/simplify/triangle_budget.h"
#include "store/base/memory_budget.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

/// Of data in a plane.
int flat_axis(const Int3& nodes) {
    return nodes.x == 1 ? 0 : nodes.y == 1 ? 1 : 2;
}

/// The part of a distance within which the full surface is simplified. Blocks of the full surface
/// are small beside the triangles of a mesh far away, whose edges at the borders of blocks then are
/// in the way. So the mesh within this part is simplified once more, within the rest of the
/// distance, in blocks of its own.
double first_limit(const ExtractQuery& query, double limit) {
    constexpr double kFar = 1.75;  // voxels, and the next one, too
    constexpr double kNear = 0.5;
    const double voxel = voxel_of(query);
    return !query.triangles && limit > kFar * voxel ? kNear * voxel : limit;
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
    std::unique_ptr<ScratchMesh> near;  // a mesh within a part of the distance
    if (simplifies(query) && query.corners() == 2) {
        lines.emplace(mesh, elements, flat_axis(store.layout().header().nodes),
                      limit_of(store, query), scratch, progress);
        elements = lines->corners();
        report.full_triangles = mesh.layout().elements;
        report.distance_bound = lines->bound() + most_moved(query);
        report.scratch_bytes += lines->scratch_bytes();
    } else if (simplifies(query)) {
        const double limit = limit_of(store, query);
        const double first = first_limit(query, limit);
        MeshSimplifier simplifier(mesh, elements, world_lattice(store, query), world_box(query),
                                  scratch, progress);
        const BudgetResult result = simplified(store, query, simplifier, first);
        corners.emplace(simplifier.corners(result.mesh));
        elements = {corners->as<ElementCorners>().data(), result.mesh.triangles};
        report.full_triangles = mesh.layout().elements;
        report.distance_bound = result.mesh.bound + most_moved(query);
        report.scratch_bytes += simplifier.scratch_bytes();
        if (query.triangles) {
            report.within_budget = result.is_met;
            report.distance = result.limit + (result.limit > 0 ? most_moved(query) : 0);
        }
        if (first < limit) {
            near = std::make_unique<ScratchMesh>(scratch);
            emit_elements(mesh, elements, scratch, *near, progress);
        }
    }
    if (near) {
        MeshSimplifier simplifier(*near, near->corners(), world_lattice(store, query),
                                  world_box(query), scratch, progress);
        const Simplified result = simplifier.within(
            simplifier.full(), limit_of(store, query) + most_moved(query) - report.distance_bound);
        corners.emplace(simplifier.corners(result));
        elements = {corners->as<ElementCorners>().data(), result.triangles};
        report.distance_bound += result.bound;
        report.scratch_bytes += near->bytes();
    }
    const ScratchMesh& vertices = near ? *near : mesh;
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
        report.border_vertices = border_vertices(vertices, elements, scratch, progress);
    }
    const EmittedMesh emitted = emit_elements(vertices, elements, scratch, sink, progress);
    report.vertices = emitted.vertices;
    report.triangles = emitted.elements;
    report.zero_area_triangles = emitted.zero_area_triangles;
}

}  // namespace isonest::detail
