#include "query/extract/extract.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <vector>

#include <isonest/error.h>

#include "query/extract/extract_query.h"
#include "query/march/contour_lines.h"
#include "query/mesh/mesh_writer.h"
#include "query/mesh/part_store.h"
#include "query/mesh/weld.h"
#include "query/traverse/planar.h"
#include "query/traverse/traversal_budget.h"
#include "store/base/workers.h"
#include "store/files/output_file.h"

namespace isonest::detail {

ExtractReport extract(const StoreReader& store, const std::filesystem::path& mesh,
                      const ExtractOptions& options, Progress& progress) {
    const auto start = std::chrono::steady_clock::now();
    std::vector<std::filesystem::path> inputs{store.path()};
    if (options.values != nullptr) {
        inputs.push_back(options.values->path());
    }
    check_output(mesh, options.force, inputs);
    ExtractQuery asked = extract_query(store, mesh, options);
    TraversalQuery& query = asked.traversal;
    const bool planar = store.layout().lattice().dimension() == 2;
    const TraversalBudget budget =
        share_memory(store, query, options.values, options.memory, 0, options.threads, true);

    ExtractReport report;
    report.dimension = store.layout().lattice().dimension();
    report.tolerance = asked.threshold;
    report.coordinate_rounding = asked.coordinate_rounding;
    report.stop = query.stop;
    report.bound = query.bound;
    if (query.culling) {
        report.culled_by = query.culling->field();
    }
    const StoreReader& values = options.values != nullptr ? *options.values : store;
    report.value_range = std::max(values.max_value() - values.min_value(), 0.0);
    const std::uint64_t chunks_before = store.chunks_read();
    const std::uint64_t bytes_before = store.bytes_read();
    Workers(budget.threads).execute([&] {
        PartStore parts(mesh.parent_path(), asked.spacing, asked.origin, budget.parts,
                        query.attributes.width());
        {
            std::optional<ChunkCache> others;
            if (options.values != nullptr) {
                others.emplace(values, budget.values_cache);
                query.attribute_values = &*others;
            }
            ChunkCache cache(store, budget.cache,
                             query.attributes.width() > 0 ? NodeSampler::kSides : ChunkSides{});
            const PartSink sink = [&](std::uint64_t order, const MeshPart& part) {
                parts.append(order, part);
            };
            const TraversalCounts counts =
                planar ? traverse_planar(
                             cache, query,
                             options.graph_scale ? PlanarKind::graph : PlanarKind::isolines,
                             budget.part_vertices, sink, progress)
                       : traverse(cache, query, budget.part_vertices, sink, progress);
            report.visited_tetrahedra = counts.visited;
            report.leaf_tetrahedra = counts.leaves;
            report.bricks = counts.bricks;
            report.error_bound = counts.error_bound;
            report.value_rounding = counts.value_rounding;
            if (options.graph_scale && counts.height_rounding > 0) {
                report.value_rounding = counts.height_rounding / std::fabs(*options.graph_scale);
            }
            report.peak_cache_bytes = cache.peak_bytes();
        }
        parts.seal();
        progress.check();
        const Weld weld(parts, mesh.parent_path());
        const bool lines = planar && !options.graph_scale;
        if (options.contours.empty()) {
            write_mesh(mesh, options.force, parts, weld, query.attributes, lines, progress);
            report.vertices = weld.vertices();
            report.triangles = weld.triangles();
            report.zero_area_triangles = lines ? 0 : parts.zero_area_triangles();
            return;
        }
        PartStore line_parts(mesh.parent_path(), {1, 1, 1}, {0, 0, 0}, budget.cache / 2,
                             query.attributes.width());
        contour_lines(
            parts, weld, options.contours, query.attributes, budget.part_vertices,
            [&](std::uint64_t order, const MeshPart& part) { line_parts.append(order, part); },
            progress);
        line_parts.seal();
        const Weld line_weld(line_parts, mesh.parent_path());
        write_mesh(mesh, options.force, line_parts, line_weld, query.attributes, true, progress);
        report.vertices = line_weld.vertices();
        report.triangles = line_weld.triangles();
        report.value_rounding += contour_rounding(options.contours, query.attributes);
    });
    if (options.plane || options.graph_scale) {
        report.error_bound += report.value_rounding;
    }
    report.chunks_total = store.layout().rows();
    report.chunks_read = store.chunks_read() - chunks_before;
    report.bytes_read = store.bytes_read() - bytes_before;
    report.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return report;
}

}  // namespace isonest::detail
