#include "query/extract/report.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <isonest/error.h>

#include "query/extract/query_checks.h"
#include "query/slabs/join_slabs.h"

namespace isonest::detail {
namespace {

double range_of(const StoreReader& values) {
    return std::max(values.max_value() - values.min_value(), 0.0);
}

/// Whether an indicator's numbers are errors of values.
bool is_error_of_values(Field field) {
    const Indicator indicator = indicator_of(field);
    return is_of_cells(field) || indicator == Indicator::deviation || indicator == Indicator::linf;
}

}  // namespace

ReportSum::ReportSum(const ExtractQuery& query, const StoreReader* store, const Int3& nodes,
                     const TraversalResult& traversal)
    : shows_values_(query.product != Product::surface && query.product != Product::isolines),
      stops_at_distance_(query.nested_distance.has_value()),
      place_(query.place(nodes)) {
    report_.tolerance = query.tolerance;
    if (store != nullptr) {
        report_.dimension = store->layout().lattice().dimension();
        report_.value_range = range_of(query.values_in(*store));
        report_.data_tolerance = tolerance_of(*store);
        report_.traversal.chunks_total = store->layout().rows();
    }
    if (const auto distance = query.asked_distance()) {
        report_.distance = DistanceReport{*distance};
    }
    if (query.traversal.box.close) {
        report_.closing = ClosingReport{*query.traversal.box.close};
    }
    const TraversalQuery& asked = query.traversal;
    const TraversalCounts& counts = traversal.counts;
    TraversalReport& report = report_.traversal;
    report.cells = asked.cells;
    report.stop = asked.stop;
    report.bound = asked.bound;
    if (asked.culling) {
        report.culled_by = asked.culling->field();
    }
    report.visited = counts.visited;
    report.leaves = counts.leaves;
    report.bricks = counts.bricks;
    report.chunks_read = traversal.chunks_read;
    report.bytes_read = traversal.bytes_read;
    report.peak_cache_bytes = traversal.peak_cache_bytes;
    report_.value_range = traversal.value_range.value_or(report_.value_range);
    if (stops_at_distance_) {
        report_.distance->bound = counts.stopped_at;
    } else {
        report_.error_bound = asked.vertices == VertexPlace::exact && is_error_of_values(asked.stop)
                                  ? 2 * counts.stopped_at
                                  : counts.stopped_at;
    }
    report_.value_rounding = counts.value_rounding.sum();
    // For a scale of 0 the heights contain no information about the values.
    if (query.product == Product::graph && counts.height_rounding > 0 && query.graph_scale != 0) {
        report_.value_rounding = counts.height_rounding / std::fabs(query.graph_scale);
    }
}

void ReportSum::add(const StageResult& stage) {
    place_.rounding += stage.moved;
    report_.value_rounding += stage.value_moved;
    report_.error_bound = std::max(report_.error_bound, stage.error);
    report_.mending.mended += stage.mended;
    report_.apart = stage.apart.value_or(report_.apart);
    if (stage.components) {
        report_.components = stage.components;
    }
    if (stage.border_vertices) {
        report_.closing->border_vertices = *stage.border_vertices;
    }
    if (stage.distance) {
        report_.distance = stage.distance;
    }
    if (stage.within_budget) {
        report_.within_budget = stage.within_budget;
    }
    if (stage.simplified_error) {
        report_.simplified_error = stage.simplified_error;
    }
}

void ReportSum::add(const EmittedMesh& mesh) {
    report_.vertices = mesh.vertices;
    report_.triangles = mesh.elements;
    report_.mending.zero_area = mesh.zero_area_triangles;
}

ExtractReport ReportSum::sum(std::uint64_t scratch_bytes) const {
    ExtractReport report = report_;
    report.coordinate_rounding = place_.rounding;
    if (stops_at_distance_) {
        report.distance->bound += place_.max_moved();
    }
    if (shows_values_) {
        report.error_bound += report.value_rounding;
    }
    if (is_error_of_values(report.traversal.stop)) {
        report.error_bound += report.data_tolerance;
        if (report.simplified_error && report.simplified_error->full_bound) {
            *report.simplified_error->full_bound += report.data_tolerance;
        }
    }
    report.scratch_bytes = scratch_bytes;
    return report;
}

ExtractReport measured(ExtractReport report, const MeasuringSink& sink) {
    report.measures = sink.measures();
    report.quality = sink.quality();
    return report;
}

ExtractReport with_manifold(ExtractReport report, const ManifoldSink& sink) {
    report.manifold = sink.report();
    report.vertices += sink.report().copies;
    return report;
}

namespace {

/// Counts or separates the places where the surface touches itself; null if neither is needed.
/// Several ranks write a mesh together, so none of them sees all of it.
std::optional<TouchingSheets> touching_sheets(const ExtractQuery& query,
                                              const ExtractOptions& options) {
    if (query.stages.manifold) {
        return TouchingSheets::separated;
    }
    const bool counts = options.quality && options.team == nullptr && query.corners() == 3 &&
                        query.product == Product::surface;
    return counts ? std::optional(TouchingSheets::counted) : std::nullopt;
}

}  // namespace

WorldOutput::WorldOutput(MeshSink& sink, const ExtractQuery& query, const ExtractOptions& options,
                         const Progress& progress)
    : sink_(sink), steps_(query.steps) {
    if (query.stages.manifold && query.corners() != 3) {
        throw Error(ErrorKind::invalid_argument,
                    "isolines have no triangles, so they cannot be made a manifold");
    }
    MeshSink* to = &sink;
    if (const auto what = touching_sheets(query, options)) {
        to = &manifold_.emplace(sink, *what, ScratchFolder::metered(options.scratch), progress);
    }
    if (query.rotation) {
        to = &turning_.emplace(*to, query.rotation->about, query.rotation->direction);
    }
    if (query.corners() == 3) {
        measuring_.emplace(*to, options.quality);
    }
}

MeshSink& WorldOutput::sink() {
    return measuring_ ? *measuring_ : turning_ ? static_cast<MeshSink&>(*turning_) : sink_;
}

ExtractReport WorldOutput::report(ExtractReport report) const {
    if (measuring_) {
        report = measured(std::move(report), *measuring_);
    }
    if (turning_) {
        const double moved = turning_->rounding();
        if (report.distance && report.distance->bound > 0) {
            report.distance->bound += moved;
        }
        report.coordinate_rounding += max_in_lattice({moved, moved, moved}, steps_);
        report.mending.zero_area = turning_->zero_area_triangles();
    }
    if (manifold_) {
        report = with_manifold(std::move(report), *manifold_);
        report.scratch_bytes += manifold_->scratch_peak();
    }
    return report;
}

ExtractReport analysed(const ExtractQuery& query, const StoreReader& store,
                       const AnalysedSurface& surface, const AnalysedMesh& mesh,
                       std::uint64_t scratch_bytes) {
    ExtractReport report;
    report.data_tolerance = tolerance_of(store);
    report.error_bound = report.data_tolerance;
    report.analysis = mesh.analysis;
    report.vertices = mesh.mesh.vertices;
    report.triangles = mesh.mesh.elements;
    report.mending = {surface.mended_triangles, mesh.mesh.zero_area_triangles};
    report.distance =
        DistanceReport{mesh.asked, mesh.bound, surface.triangles + surface.dropped_triangles};
    report.within_budget = mesh.within_budget;
    if (query.stages.components) {
        report.components = ComponentReport{surface.components, surface.dropped_components,
                                            surface.dropped_triangles, surface.largest_dropped};
    }
    if (query.traversal.box.close) {
        report.closing = ClosingReport{*query.traversal.box.close, surface.border_vertices};
    }
    report.coordinate_rounding = surface.coordinate_rounding;
    report.value_rounding = surface.value_rounding;
    report.value_range = range_of(query.values_in(store));
    report.traversal.cells = query.traversal.cells;
    report.traversal.stop = query.traversal.stop;
    report.traversal.bound = query.traversal.bound;
    report.traversal.chunks_total = store.layout().rows();
    report.scratch_bytes = scratch_bytes;
    return report;
}

ExtractReport smoothed(const SmoothedNet& net, LabelMesh mesh, std::uint64_t scratch_bytes) {
    ExtractReport report;
    report.vertices = mesh.net.vertices;
    report.triangles = mesh.net.triangles;
    report.value_range = range_of(net.store);
    report.coordinate_rounding = net.rounding;
    report.traversal.cells = Cells::hexahedra;
    report.traversal.bricks = net.counts.blocks;
    report.traversal.chunks_read = net.counts.chunks_read;
    report.traversal.chunks_total = net.store.layout().rows();
    report.traversal.bytes_read = net.counts.bytes_read;
    report.traversal.peak_cache_bytes = net.counts.peak_cache_bytes;
    if (net.close) {
        report.closing = ClosingReport{*net.close};
    }
    report.mending.zero_area = mesh.net.no_area;
    report.components = mesh.components;
    report.distance = mesh.distance;
    report.within_budget = mesh.within_budget;
    SmoothReport& smooth = report.smooth.emplace();
    smooth.passes = net.smoothing.passes;
    if (mesh.net.triangles > 0) {
        // The movement itself was rounded to float32.
        constexpr double kRoundedUp = 1 + 1e-6;
        const double distance = mesh.distance ? mesh.distance->bound : 0;
        const LatticeSteps steps = net.store.layout().header().steps();
        smooth.bound = kRoundedUp * mesh.net.moved + net.rounding * steps.diagonal() + distance;
        smooth.nodes_beyond = net.smoothing.keep_nodes ? 0 : distance;
    }
    smooth.neighbours = std::move(mesh.neighbours);
    report.scratch_bytes = scratch_bytes;
    return report;
}

ExtractReport in_cells(ExtractReport report, double by, double by_in_world,
                       std::uint64_t scratch_bytes) {
    report.coordinate_rounding += by;
    if (report.distance) {
        report.distance->bound += by_in_world;
    }
    if (report.smooth && report.triangles > 0) {
        report.smooth->bound += by_in_world;
        if (report.smooth->nodes_beyond > 0) {
            report.smooth->nodes_beyond += by_in_world;
        }
    }
    report.scratch_bytes = scratch_bytes;
    return report;
}

ExtractReport with_interfaces(ExtractReport report, const InterfaceReport& interfaces) {
    report.interfaces = interfaces;
    report.measures->volume.reset();  // its triangles belong to more than one solid
    return report;
}

ExtractReport timed(ExtractReport report, std::chrono::steady_clock::time_point start) {
    report.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return report;
}

ExtractReport marched(const MeshLayout& layout, const JoinedMesh& joined,
                      const SettledMesh& settled, double rounding, double value_range,
                      std::uint64_t scratch_bytes) {
    ExtractReport report;
    report.vertices = layout.vertices;
    report.triangles = layout.elements;
    report.traversal.cells = Cells::hexahedra;
    report.traversal.visited = joined.cells;
    report.traversal.leaves = joined.cells;
    report.coordinate_rounding = rounding + settled.moved_by_mending + settled.moved_apart;
    report.value_range = value_range;
    report.mending = {joined.mended.found - joined.mended.left, settled.zero_area};
    report.apart = settled.apart;
    report.measures = settled.measures;
    report.quality = settled.quality;
    report.scratch_bytes = scratch_bytes;
    return report;
}

}  // namespace isonest::detail
