// The distance of two surfaces is at most the sum of their distances from a third one (the triangle
// inequality of Hausdorff distances). So a mesh within b of the full surface that is simplified
// within D - b is within D: query/DISTANCE.md, "A kept analysis".
#include "query/extract/extract_analysed.h"

#include <algorithm>
#include <chrono>

#include "query/extract/distance_limits.h"
#include "query/extract/kept_analysis.h"
#include "query/extract/run_extraction.h"
#include "query/extract/whole_mesh.h"
#include "query/mesh/emit_mesh.h"
#include "query/simplify/triangle_budget.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

/// A smaller share of the distance is not worth a simplification.
constexpr double kWorthwhile = 0.02;
/// Of a step's distance: the first that is tried to get fewer triangles.
constexpr double kFirstShare = 0.2;

/// Extracts the surface, makes its ladder and writes the file.
void make_analysis(const StoreReader& store, const ExtractQuery& query,
                   const std::filesystem::path& scratch, const ExtractOptions& options,
                   Progress& progress) {
    ExtractQuery full = query;
    full.distance.reset();
    full.triangles.reset();
    full.analysis_folder.reset();
    ScratchMesh mesh(scratch);
    ExtractOptions rest = options;
    rest.quality = false;
    const ExtractReport r = run_extraction(store, full, mesh, rest, progress);
    AnalysedSurface surface;
    surface.triangles = r.triangles;
    surface.components = r.components;
    surface.dropped_components = r.dropped_components;
    surface.dropped_triangles = r.dropped_triangles;
    surface.largest_dropped = r.largest_dropped;
    surface.border_vertices = r.border_vertices;
    surface.mended_triangles = r.mended_triangles;
    surface.coordinate_rounding = r.coordinate_rounding;
    surface.value_rounding = r.value_rounding;
    full.coordinate_rounding = r.coordinate_rounding;
    Workers(whole_mesh_threads(store, query, options)).execute([&] {
        MeshSimplifier simplifier(mesh, mesh.corners(), world_lattice(store, query),
                                  world_box(query), scratch, progress);
        keep_analysis(store, query, surface,
                      distance_ladder(simplifier, mesh, voxel_of(query), most_moved(full), scratch,
                                      progress));
    });
}

/// A mesh made from a step of the ladder.
struct FromStep {
    std::size_t step = 0;
    double rest = 0;  ///< within which the step is simplified; 0: it stays as it is
    std::optional<std::uint64_t> triangles = {};  ///< looks for the smallest distance up to `rest`
};

/// The last step that is within the limit.
std::optional<FromStep> step_for_distance(const AnalysisFile& analysis, double limit) {
    const auto& steps = analysis.steps();
    std::optional<FromStep> chosen;
    for (std::size_t i = 0; i < steps.size() && steps[i].bound <= limit; ++i) {
        const double rest = limit - steps[i].bound;
        chosen = FromStep{i, rest > kWorthwhile * limit ? rest : 0, {}};
    }
    return chosen;
}

/// The last step that has too many triangles, simplified up to the next one or the limit.
std::optional<FromStep> step_for_triangles(const AnalysisFile& analysis, std::uint64_t triangles,
                                           double limit) {
    const auto& steps = analysis.steps();
    std::optional<FromStep> chosen;
    for (std::size_t i = 0; i < steps.size() && steps[i].bound <= limit; ++i) {
        if (steps[i].triangles <= triangles) {
            break;
        }
        const double end = i + 1 < steps.size() ? std::min(limit, steps[i + 1].bound) : limit;
        chosen = FromStep{i, end - steps[i].bound, triangles};
    }
    return chosen;
}

class AnalysedExtraction {
  public:
    AnalysedExtraction(const StoreReader& store, const ExtractQuery& query,
                       const AnalysisFile& analysis, const std::filesystem::path& scratch,
                       Progress& progress)
        : store_(store),
          query_(query),
          analysis_(analysis),
          scratch_(scratch),
          progress_(progress),
          moved_(most_moved(query)) {}

    void run(const FromStep& from, MeshSink& sink, ExtractReport& report) {
        const AnalysisStep& step = analysis_.steps()[from.step];
        ScratchMesh mesh(scratch_);
        load_step(analysis_, from.step, layout_of(query_.traversal.attributes, 3), mesh);
        report.scratch_bytes += mesh.bytes();
        if (!(from.rest > 0)) {
            emit(mesh, mesh.corners(), step.bound, sink, report);
            return;
        }
        MeshSimplifier simplifier(mesh, mesh.corners(), world_lattice(store_, query_),
                                  world_box(query_), scratch_, progress_);
        if (!from.triangles) {
            emit(mesh, simplifier, simplifier.within(simplifier.full(), from.rest), step.bound,
                 sink, report);
            return;
        }
        const BudgetResult result =
            within_budget(simplifier, *from.triangles,
                          std::min(from.rest / 2, kFirstShare * step.bound), from.rest);
        const std::size_t next = from.step + 1;
        if (!result.is_met && next < analysis_.steps().size() &&
            analysis_.steps()[next].bound + moved_ <= *query_.distance) {
            run({next, 0, {}}, sink, report);
            report.within_budget = analysis_.steps()[next].triangles <= *from.triangles;
            report.distance = analysis_.steps()[next].bound + moved_;
            return;
        }
        if (!result.is_met && any_distance(store_, query_)) {
            refuse_budget(store_, result.mesh.triangles);
        }
        emit(mesh, simplifier, result.mesh, step.bound, sink, report);
        report.within_budget = result.is_met;
        report.distance = step.bound + result.limit + moved_;
    }

  private:
    void emit(const ScratchMesh& mesh, const MeshSimplifier& simplifier, const Simplified& result,
              double bound, MeshSink& sink, ExtractReport& report) {
        const ScratchFile corners = simplifier.corners(result);
        report.scratch_bytes += simplifier.scratch_bytes();
        emit(mesh, {corners.as<ElementCorners>().data(), result.triangles}, bound + result.bound,
             sink, report);
    }
    void emit(const ScratchMesh& mesh, std::span<const ElementCorners> elements, double bound,
              MeshSink& sink, ExtractReport& report) {
        report.distance_bound = bound + moved_;
        const EmittedMesh emitted = emit_elements(mesh, elements, scratch_, sink, progress_);
        report.vertices = emitted.vertices;
        report.triangles = emitted.elements;
        report.zero_area_triangles = emitted.zero_area_triangles;
    }

    const StoreReader& store_;
    const ExtractQuery& query_;
    const AnalysisFile& analysis_;
    const std::filesystem::path& scratch_;
    Progress& progress_;
    double moved_;
};

AnalysisUse use_of(AnalysisState state) {
    switch (state) {
        case AnalysisState::current:
            return AnalysisUse::found;
        case AnalysisState::stale:
            return AnalysisUse::replaced_stale;
        case AnalysisState::damaged:
            return AnalysisUse::replaced_damaged;
        case AnalysisState::none:
            break;
    }
    return AnalysisUse::made;
}

void report_surface(const AnalysedSurface& surface, const ExtractQuery& query,
                    ExtractReport& report) {
    report.full_triangles = surface.triangles + surface.dropped_triangles;
    report.components = surface.components;
    report.dropped_components = surface.dropped_components;
    report.dropped_triangles = surface.dropped_triangles;
    report.largest_dropped = surface.largest_dropped;
    report.border_vertices = surface.border_vertices;
    report.mended_triangles = surface.mended_triangles;
    report.coordinate_rounding = surface.coordinate_rounding;
    report.value_rounding = surface.value_rounding;
    report.distance = query.distance;
    report.closed = query.traversal.box.close;
    report.stop = query.traversal.stop;
    report.bound = query.traversal.bound;
}

}  // namespace

std::optional<ExtractReport> extract_analysed(const StoreReader& store, const ExtractQuery& asked,
                                              MeshSink& sink, const ExtractOptions& options,
                                              Progress& progress) {
    const auto start = std::chrono::steady_clock::now();
    // Far from 0 float32 may take more than the first step has.
    if (*asked.distance < kFirstLadderStep * voxel_of(asked) ||
        kFirstLadderStep * voxel_of(asked) < 2 * most_moved(asked)) {
        return std::nullopt;
    }
    const int threads = whole_mesh_threads(store, asked, options);
    const std::filesystem::path scratch =
        options.scratch.empty() ? std::filesystem::temp_directory_path() : options.scratch;
    FoundAnalysis found = find_analysis(store, asked);
    const AnalysisUse use = use_of(found.state);
    std::vector<std::filesystem::path> inputs{store.path(), found.path};
    if (asked.values != nullptr) {
        inputs.push_back(asked.values->path());
    }
    sink.prepare(layout_of(asked.traversal.attributes, asked.corners()), inputs);
    if (use != AnalysisUse::found) {
        found.file.reset();
        make_analysis(store, asked, scratch, options, progress);
        found = find_analysis(store, asked);
    }
    if (found.state != AnalysisState::current) {
        throw Error(ErrorKind::corrupt, {found.path.string()},
                    "what was written a moment ago is not there any more: " + found.problem);
    }
    const AnalysisFile& analysis = *found.file;
    ExtractQuery query = asked;
    query.coordinate_rounding = analysis.surface().coordinate_rounding;
    const double limit = limit_of(store, query);
    const std::optional<FromStep> from = query.triangles
                                             ? step_for_triangles(analysis, *query.triangles, limit)
                                             : step_for_distance(analysis, limit);
    if (!from) {
        return std::nullopt;
    }
    ExtractReport report;
    report.analysis = use;
    report.analysis_file = found.path;
    report_surface(analysis.surface(), query, report);
    const StoreReader& values = query.values != nullptr ? *query.values : store;
    report.value_range = std::max(values.max_value() - values.min_value(), 0.0);
    report.chunks_total = store.layout().rows();
    Workers(threads).execute([&] {
        AnalysedExtraction(store, query, analysis, scratch, progress).run(*from, sink, report);
    });
    report.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return report;
}

}  // namespace isonest::detail
