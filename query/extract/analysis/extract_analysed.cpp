// The distance of two surfaces is at most the sum of their distances from a third one (the triangle
// inequality of Hausdorff distances). So a mesh within b of the full surface that is simplified
// within D - b is within D: query/DISTANCE.md, "A kept analysis".
#include "query/extract/analysis/extract_analysed.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <numbers>

#include "query/extract/analysis/kept_analysis.h"
#include "query/extract/run_extraction.h"
#include "query/extract/stages/distance_limits.h"
#include "query/extract/stages/distance_stage.h"
#include "query/mesh/emit_mesh.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

/// A smaller share of the distance is not worth a simplification.
constexpr double kWorthwhile = 0.02;
/// Of a distance: meshes that are nearer to the surface than that are not tried.
constexpr double kNearest = 0.5;
/// A mesh with this share of the triangles asked for is near enough.
constexpr double kNearlyAll = 0.9;
constexpr int kMostTries = 3;  ///< between a distance that is too small and one that is not

/// Extracts the surface, makes its ladder and writes the file.
void make_analysis(const StoreReader& store, const ExtractQuery& query,
                   const ScratchFolder& scratch, const ExtractOptions& options,
                   Progress& progress) {
    ExtractQuery full = query;
    full.stages.distance.reset();
    full.analysis_folder.reset();
    ScratchMesh mesh(scratch);
    ExtractOptions rest = options;
    rest.quality = false;
    const ExtractReport r = run_extraction(store, full, mesh, rest, progress);
    // The extraction's own files were there beside the mesh.
    scratch.meter()->add(r.scratch_bytes);
    scratch.meter()->remove(r.scratch_bytes);
    AnalysedSurface surface;
    surface.triangles = r.triangles;
    if (r.components) {
        surface.components = r.components->components;
        surface.dropped_components = r.components->dropped;
        surface.dropped_triangles = r.components->dropped_triangles;
        surface.largest_dropped = r.components->largest_dropped;
    }
    if (r.closing) {
        surface.border_vertices = r.closing->border_vertices;
    }
    surface.mended_triangles = r.mending.mended;
    surface.coordinate_rounding = r.coordinate_rounding;
    surface.value_rounding = r.value_rounding;
    full.coordinate_rounding = r.coordinate_rounding;
    Workers(distance_stage_threads(store, options)).execute([&] {
        MeshSimplifier simplifier(mesh, mesh.corners(), world_lattice(store, query),
                                  world_box(query), scratch, progress);
        keep_analysis(store, query, surface,
                      distance_ladder(simplifier, mesh, voxel_of(query), most_moved(full), scratch,
                                      progress));
    });
}

/// A mesh that was made from a step of the ladder.
struct FromStep {
    std::unique_ptr<ScratchMesh> mesh;  ///< the step
    std::unique_ptr<MeshSimplifier> simplifier;
    std::optional<Simplified> simplified;  ///< nothing: the step as it is
    double bound = 0;                      ///< from the full surface

    [[nodiscard]] std::uint64_t triangles() const {
        return simplified ? simplified->triangles : mesh->layout().elements;
    }
};

class AnalysedExtraction {
  public:
    AnalysedExtraction(const StoreReader& store, const ExtractQuery& query,
                       const AnalysisFile& analysis, const ScratchFolder& scratch,
                       Progress& progress)
        : store_(store),
          query_(query),
          analysis_(analysis),
          scratch_(scratch),
          progress_(progress),
          moved_(most_moved(query)) {}

    void within(double limit, MeshSink& sink, ExtractReport& report) {
        emit(smallest_within(limit), sink, report);
    }

    /// The smallest distance up to `limit` that is found at which there are so few triangles.
    void within_budget(std::uint64_t triangles, double limit, MeshSink& sink,
                       ExtractReport& report) {
        const auto is_met = [&](const FromStep& from) { return from.triangles() <= triangles; };
        double too_small = 0;
        double distance = std::min(first_distance(triangles), limit);
        FromStep best = smallest_within(distance);
        while (!is_met(best) && distance < limit) {
            too_small = distance;
            distance = std::min(next_distance(distance), limit);
            best = smallest_within(distance);
        }
        for (int i = 0;
             i < kMostTries && too_small > 0 && is_met(best) &&
             static_cast<double>(best.triangles()) < kNearlyAll * static_cast<double>(triangles);
             ++i) {
            const double middle = std::sqrt(too_small * distance);
            FromStep next = smallest_within(middle);
            if (is_met(next)) {
                best = std::move(next);
                distance = middle;
            } else {
                too_small = middle;
            }
        }
        if (!is_met(best) && any_distance(store_, query_)) {
            refuse_budget(store_, triangles, best.triangles(), sizes_of(best));
        }
        report.within_budget = is_met(best);
        report.distance->asked = distance + moved_;
        emit(best, sink, report);
    }

  private:
    /// Where a search begins: two octaves below the first step with so few triangles.
    [[nodiscard]] double first_distance(std::uint64_t triangles) const {
        const auto& steps = analysis_.steps();
        std::size_t few = 0;
        while (few + 1 < steps.size() && steps[few].triangles > triangles) {
            ++few;
        }
        constexpr std::size_t kSteps = 4;
        return steps[few < kSteps ? 0 : few - kSteps].bound;
    }
    /// That of the next step, or as much further as from one step to the next.
    [[nodiscard]] double next_distance(double distance) const {
        const auto& steps = analysis_.steps();
        const auto next = std::find_if(steps.begin(), steps.end(), [&](const AnalysisStep& step) {
            return step.bound > distance;
        });
        return next != steps.end() ? next->bound : distance * std::numbers::sqrt2;
    }
    /// Of the steps between the distance and a half of it, each simplified within what is left, the
    /// one with the fewest triangles. REQUIRES: the first step is within the limit.
    [[nodiscard]] FromStep smallest_within(double limit) {
        const auto& steps = analysis_.steps();
        std::size_t last = 0;
        while (last + 1 < steps.size() && steps[last + 1].bound <= limit) {
            ++last;
        }
        FromStep best = from_step(last, limit);
        for (std::size_t i = last; i > 0 && steps[i - 1].bound >= kNearest * limit; --i) {
            FromStep next = from_step(i - 1, limit);
            if (next.triangles() < best.triangles()) {
                best = std::move(next);
            }
        }
        return best;
    }
    [[nodiscard]] FromStep from_step(std::size_t step, double limit) {
        FromStep from;
        from.mesh = std::make_unique<ScratchMesh>(scratch_);
        load_step(analysis_, step,
                  layout_of(query_.traversal.attributes, 3, store_.layout().header().unit,
                            store_.layout().header().frame),
                  *from.mesh);
        from.bound = analysis_.steps()[step].bound;
        const double rest = limit - from.bound;
        if (rest > kWorthwhile * limit) {
            from.simplifier = std::make_unique<MeshSimplifier>(
                *from.mesh, from.mesh->corners(), world_lattice(store_, query_), world_box(query_),
                scratch_, progress_);
            from.simplified = from.simplifier->within(from.simplifier->full(), rest);
            from.bound += from.simplified->bound;
        }
        return from;
    }
    [[nodiscard]] ComponentSizes sizes_of(const FromStep& from) const {
        const std::uint64_t vertices = from.mesh->layout().vertices;
        if (!from.simplified) {
            return component_sizes(vertices, from.mesh->corners(), scratch_);
        }
        return component_sizes(vertices, from.simplifier->corners(*from.simplified).all(),
                               scratch_);
    }
    void emit(const FromStep& from, MeshSink& sink, ExtractReport& report) {
        CornerView elements = from.mesh->corners();
        std::optional<CornerFile> corners;
        if (from.simplified) {
            corners.emplace(from.simplifier->corners(*from.simplified));
            elements = corners->all();
        }
        report.distance->bound = from.bound + moved_;
        const EmittedMesh emitted = emit_elements(*from.mesh, elements, scratch_, sink, progress_);
        report.vertices = emitted.vertices;
        report.triangles = emitted.elements;
        report.mending.zero_area = emitted.zero_area_triangles;
    }

    const StoreReader& store_;
    const ExtractQuery& query_;
    const AnalysisFile& analysis_;
    const ScratchFolder& scratch_;
    Progress& progress_;
    double moved_;
};

/// Whether the meshes of the analysis are too coarse for what is asked.
bool is_too_fine(const ExtractQuery& query, const AnalysisFile& analysis, double limit) {
    const AnalysisStep& first = analysis.steps().front();
    return limit < first.bound || (query.stages.distance->triangles &&
                                   first.triangles <= *query.stages.distance->triangles);
}

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
    report.distance = DistanceReport{query.stages.distance->within, 0,
                                     surface.triangles + surface.dropped_triangles};
    if (query.stages.components) {
        report.components = ComponentReport{surface.components, surface.dropped_components,
                                            surface.dropped_triangles, surface.largest_dropped};
    }
    if (query.traversal.box.close) {
        report.closing = ClosingReport{*query.traversal.box.close, surface.border_vertices};
    }
    report.mending.mended = surface.mended_triangles;
    report.coordinate_rounding = surface.coordinate_rounding;
    report.value_rounding = surface.value_rounding;
    report.traversal.cells = query.traversal.cells;
    report.traversal.stop = query.traversal.stop;
    report.traversal.bound = query.traversal.bound;
}

}  // namespace

std::optional<ExtractReport> extract_analysed(const StoreReader& store, const ExtractQuery& asked,
                                              MeshSink& sink, const ExtractOptions& options,
                                              Progress& progress) {
    const auto start = std::chrono::steady_clock::now();
    // Far from 0 float32 may take more than the first step has.
    if (asked.stages.distance->within < kFirstLadderStep * voxel_of(asked) ||
        kFirstLadderStep * voxel_of(asked) < 2 * most_moved(asked)) {
        return std::nullopt;
    }
    const int threads = distance_stage_threads(store, options);
    const ScratchFolder scratch = ScratchFolder::metered(options.scratch);
    FoundAnalysis found = find_analysis(store, asked);
    const AnalysisUse use = use_of(found.state);
    std::vector<std::filesystem::path> inputs{store.path(), found.path};
    if (asked.values != nullptr) {
        inputs.push_back(asked.values->path());
    }
    sink.prepare(layout_of(asked.traversal.attributes, asked.corners(),
                           store.layout().header().unit, store.layout().header().frame),
                 inputs);
    if (use != AnalysisUse::found) {
        require_place(found.path, store);
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
    if (is_too_fine(query, analysis, limit)) {
        return std::nullopt;
    }
    ExtractReport report;
    report.analysis = AnalysisReport{use, found.path};
    report_surface(analysis.surface(), query, report);
    const StoreReader& values = query.values != nullptr ? *query.values : store;
    report.value_range = std::max(values.max_value() - values.min_value(), 0.0);
    report.traversal.chunks_total = store.layout().rows();
    Workers(threads).execute([&] {
        AnalysedExtraction extraction(store, query, analysis, scratch, progress);
        if (const auto& most = query.stages.distance->triangles) {
            extraction.within_budget(*most, limit, sink, report);
        } else {
            extraction.within(limit, sink, report);
        }
    });
    report.scratch_bytes = scratch.meter()->peak();
    report.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return report;
}

}  // namespace isonest::detail
