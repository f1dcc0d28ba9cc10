#include "query/extract/run_extraction.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <vector>

#include "query/distance/traverse_within_distance.h"
#include "query/extract/contour_lines.h"
#include "query/extract/distance_limits.h"
#include "query/extract/extract_analysed.h"
#include "query/extract/mend_mesh.h"
#include "query/extract/whole_mesh.h"
#include "query/mesh/border_count.h"
#include "query/mesh/emit_mesh.h"
#include "query/mesh/measuring_sink.h"
#include "query/traverse/hexahedra/traverse_quadrilaterals.h"
#include "query/traverse/planar.h"
#include "query/traverse/traversal_budget.h"
#include "query/view/label_view.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

/// Heap of the threads that go with a distance, in all.
std::uint64_t distance_heap(const StoreReader& store, const ExtractQuery& query,
                            const ExtractOptions& options) {
    if (!query.nested_distance) {
        return 0;
    }
    const std::uint64_t each = distance_traversal_heap(store.layout(), query.traversal);
    const std::uint64_t most = options.memory / 2 / each;
    return each * std::clamp<std::uint64_t>(
                      most, 1, static_cast<std::uint64_t>(Workers::count_of(options.threads)));
}

TraversalCounts within_distance(const StoreReader& store, const ExtractQuery& asked,
                                ChunkCache& cache, const TraversalBudget& budget,
                                const std::filesystem::path& scratch, const PartSink& sink,
                                ExtractReport& report, Progress& progress) {
    const DistanceTraversal done =
        traverse_within_distance(cache, asked.traversal, nested_limit_of(store, asked), scratch,
                                 budget.part_vertices, sink, progress);
    report.scratch_bytes += done.scratch_bytes;
    report.distance_bound = done.counts.error_bound;
    TraversalCounts counts = done.counts;
    counts.error_bound = 0;
    return counts;
}

/// Traverses and fills `parts`; what that takes beside them is free again afterwards.
void fill_parts(const StoreReader& store, ExtractQuery& asked, const TraversalBudget& budget,
                PartStore& parts, const std::filesystem::path& scratch, ExtractReport& report,
                Progress& progress) {
    TraversalQuery& query = asked.traversal;
    std::optional<ChunkCache> others;
    if (asked.values != nullptr) {
        others.emplace(*asked.values, budget.values_cache);
        query.attribute_values = &*others;
    }
    std::optional<LabelView> label;
    if (asked.label) {
        label.emplace(store, asked.label->id, asked.label->within->first,
                      asked.label->within->second);
    }
    const ChunkSource& source = label ? static_cast<const ChunkSource&>(*label) : store;
    ChunkCache cache(source, budget.cache,
                     query.attributes.width() > 0 ? NodeSampler::kSides : ChunkSides{});
    const PartSink sink = [&](std::uint64_t order, const MeshPart& part) {
        parts.append(order, part);
    };
    const bool is_graph = asked.product == Product::graph;
    const TraversalCounts counts =
        asked.nested_distance
            ? within_distance(store, asked, cache, budget, scratch, sink, report, progress)
        : is_graph && query.cells == Cells::hexahedra
            ? traverse_quadrilaterals(cache, query, budget.part_vertices, sink, progress)
        : is_graph || asked.product == Product::isolines
            ? traverse_planar(cache, query, is_graph ? PlanarKind::graph : PlanarKind::isolines,
                              budget.part_vertices, sink, progress)
            : traverse(cache, query, budget.part_vertices, sink, progress);
    query.attribute_values = nullptr;
    report.visited_tetrahedra = counts.visited;
    report.leaf_tetrahedra = counts.leaves;
    report.bricks = counts.bricks;
    const Indicator indicator = indicator_of(query.stop);
    const bool is_error = indicator == Indicator::deviation || indicator == Indicator::linf;
    report.error_bound = query.vertices == VertexPlace::exact && is_error ? 2 * counts.error_bound
                                                                          : counts.error_bound;
    report.value_rounding = counts.value_rounding;
    // Laid flat, heights say nothing of the values.
    if (is_graph && counts.height_rounding > 0 && asked.graph_scale != 0) {
        report.value_rounding = counts.height_rounding / std::fabs(asked.graph_scale);
    }
    report.peak_cache_bytes = cache.peak_bytes();
    report.chunks_read = cache.chunks_read();
    report.bytes_read = cache.bytes_read();
}

void emit(const PartStore& parts, const Weld& weld, const MeshLayout& layout, MeshSink& sink,
          ExtractReport& report, Progress& progress) {
    emit_mesh(parts, weld, layout, sink, progress);
    report.vertices = weld.vertices();
    report.triangles = weld.triangles();
}

}  // namespace

ExtractReport run_extraction(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                             const ExtractOptions& options, Progress& progress) {
    if (options.quality && asked.corners() == 3) {
        MeasuringSink measuring(sink);
        ExtractOptions rest = options;
        rest.quality = false;
        ExtractReport report = run_extraction(store, std::move(asked), measuring, rest, progress);
        report.quality = measuring.quality();
        return report;
    }
    std::optional<AnalysisUse> analysis;
    if (asked.analysis_folder && simplifies(asked)) {
        if (std::optional<ExtractReport> report =
                extract_analysed(store, asked, sink, options, progress)) {
            return *report;
        }
        analysis = AnalysisUse::not_used;
    }
    const auto start = std::chrono::steady_clock::now();
    std::vector<std::filesystem::path> inputs{store.path()};
    if (asked.values != nullptr) {
        inputs.push_back(asked.values->path());
    }
    const AttributeChoice& attributes = asked.traversal.attributes;
    const MeshLayout layout = layout_of(attributes, asked.corners(), store.layout().header().unit);
    sink.prepare(layout, inputs);
    if (changes_whole_mesh(asked)) {
        whole_mesh_threads(store, asked, options);
    }
    const std::uint64_t distances = distance_heap(store, asked, options);
    const int threads =
        distances > 0
            ? static_cast<int>(distances / distance_traversal_heap(store.layout(), asked.traversal))
            : options.threads;
    const TraversalBudget budget = share_memory(store, asked.traversal, asked.values,
                                                options.memory, distances, threads, true);
    const std::filesystem::path scratch =
        options.scratch.empty() ? std::filesystem::temp_directory_path() : options.scratch;

    ExtractReport report;
    report.analysis = analysis;
    report.dimension = store.layout().lattice().dimension();
    report.tolerance = asked.threshold;
    report.distance = asked.nested_distance ? asked.nested_distance : asked.distance;
    report.closed = asked.traversal.box.close;
    report.coordinate_rounding = asked.coordinate_rounding;
    report.stop = asked.traversal.stop;
    report.bound = asked.traversal.bound;
    if (asked.traversal.culling) {
        report.culled_by = asked.traversal.culling->field();
    }
    const StoreReader& values = asked.values != nullptr ? *asked.values : store;
    report.value_range = std::max(values.max_value() - values.min_value(), 0.0);
    std::optional<ScratchMesh> whole;
    if (changes_whole_mesh(asked)) {
        whole.emplace(scratch);
    }
    bool mends = false;
    Workers(budget.threads).execute([&] {
        PartStore parts(scratch, asked.spacing, asked.origin, budget.parts, attributes.width());
        fill_parts(store, asked, budget, parts, scratch, report, progress);
        parts.seal();
        progress.check();
        const Weld weld(parts, scratch);
        mends = asked.corners() == 3 && parts.zero_area_triangles() > 0;
        if (mends && !whole) {
            whole.emplace(scratch);
        }
        if (report.closed && store.has_missing()) {
            report.border_vertices = border_vertices(parts, weld, scratch, progress);
        }
        if (whole) {
            emit_mesh(parts, weld, layout, *whole, progress);
            return;
        }
        if (asked.product != Product::contours) {
            emit(parts, weld, layout, sink, report, progress);
            return;
        }
        PartStore line_parts(scratch, {1, 1, 1}, {0, 0, 0}, budget.cache / 2, attributes.width());
        contour_lines(
            parts, weld, asked.contours, attributes, budget.part_vertices,
            [&](std::uint64_t order, const MeshPart& part) { line_parts.append(order, part); },
            progress);
        line_parts.seal();
        const Weld line_weld(line_parts, scratch);
        emit(line_parts, line_weld, layout, sink, report, progress);
        report.value_rounding += contour_rounding(asked.contours, attributes);
    });
    if (whole) {
        if (mends) {
            mend_mesh(asked, *whole, scratch, report, progress);
        }
        Workers(whole_mesh_threads(store, asked, options)).execute([&] {
            emit_whole_mesh(store, asked, *whole, sink, options, scratch, report, progress);
        });
    }
    if (asked.nested_distance) {
        report.distance_bound += most_moved(asked);
    }
    if (asked.product != Product::surface && asked.product != Product::isolines) {
        report.error_bound += report.value_rounding;
    }
    report.chunks_total = store.layout().rows();
    report.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return report;
}

}  // namespace isonest::detail
