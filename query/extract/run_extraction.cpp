// The flow of every extraction:
//
//     what is extracted -> parts            query/extract/find_parts.h
//     parts             -> welded mesh      query/mesh/weld.h
//     welded mesh       -> stages in a row  query/extract/stages/stage_row.h
//     what is left      -> sink
//
// Without a stage that has work, the welded parts go to the sink as they are. Contour lines are
// lines of a welded slice, and become parts once more.
#include "query/extract/run_extraction.h"

#include <algorithm>
#include <chrono>
#include <vector>

#include "query/apart/parts_apart.h"
#include "query/extract/analysis/extract_analysed.h"
#include "query/extract/find_parts.h"
#include "query/extract/stages/apart_stage.h"
#include "query/extract/stages/contour_lines.h"
#include "query/extract/stages/distance_limits.h"
#include "query/extract/stages/stage_row.h"
#include "query/mesh/emit_mesh.h"
#include "query/mesh/measuring_sink.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

using Clock = std::chrono::steady_clock;

/// One extraction, up to a mesh in the sink.
class Extraction {
  public:
    Extraction(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
               const ExtractOptions& options, Progress& progress)
        : store_(store),
          asked_(std::move(asked)),
          sink_(sink),
          options_(options),
          progress_(progress),
          scratch_(options.scratch.empty() ? std::filesystem::temp_directory_path()
                                           : options.scratch),
          layout_(layout_of(asked_.traversal.attributes, asked_.corners(),
                            store.layout().header().unit)) {}

    /// Refuses what cannot be, before any work.
    void prepare() {
        std::vector<std::filesystem::path> inputs{store_.path()};
        if (asked_.values != nullptr) {
            inputs.push_back(asked_.values->path());
        }
        sink_.prepare(layout_, inputs);
        row_ =
            std::make_unique<StageRow>(StageSetting{store_, asked_, options_, scratch_, progress_});
        begin_report();
    }
    /// Where the traversal's parts are to go; those beyond `memory` bytes to a temporary file.
    FoundParts begin_parts(std::uint64_t memory) {
        parts_.emplace(scratch_, asked_.spacing, asked_.origin, memory,
                       asked_.traversal.attributes.width());
        if (asked_.keeps_apart()) {
            parts_->watch({sight_apart(asked_.coordinate_rounding, asked_.least_apart),
                           asked_.traversal.box});
        }
        return {asked_.traversal.iso, &*parts_, &report_};
    }
    /// From the parts to the mesh in the sink.
    ExtractReport finish(const TraversalBudget& budget) {
        std::vector<Stage*> stages;
        std::shared_ptr<ScratchMesh> whole;
        Workers(budget.threads).execute([&] {
            progress_.check();
            const Weld weld(*parts_, scratch_);
            if (asked_.keeps_apart() && parts_->zero_area_triangles() == 0) {
                count_apart(
                    keep_parts_apart(*parts_, weld, apart_range(asked_), scratch_, progress_),
                    asked_, report_);
            }
            stages = row_->with_work(*parts_);
            if (!stages.empty()) {
                whole = std::make_shared<ScratchMesh>(scratch_);
                emit_mesh(*parts_, weld, layout_, *whole, progress_);
            } else if (asked_.product == Product::contours) {
                emit_contours(weld, budget);
            } else {
                emit(*parts_, weld);
            }
        });
        parts_.reset();
        if (whole) {
            Workers(row_->threads()).execute([&] { run_stages(stages, std::move(whole)); });
        }
        end_report();
        return report_;
    }
    [[nodiscard]] const ExtractQuery& asked() const { return asked_; }
    [[nodiscard]] const std::filesystem::path& scratch() const { return scratch_; }

  private:
    void begin_report() {
        report_.dimension = store_.layout().lattice().dimension();
        report_.tolerance = asked_.threshold;
        report_.coordinate_rounding = asked_.coordinate_rounding;
        const StoreReader& values = asked_.values != nullptr ? *asked_.values : store_;
        report_.value_range = std::max(values.max_value() - values.min_value(), 0.0);
        report_.traversal.stop = asked_.traversal.stop;
        report_.traversal.bound = asked_.traversal.bound;
        report_.traversal.chunks_total = store_.layout().rows();
        if (asked_.traversal.culling) {
            report_.traversal.culled_by = asked_.traversal.culling->field();
        }
        if (const auto distance = asked_.asked_distance()) {
            report_.distance = DistanceReport{*distance};
        }
        if (asked_.traversal.box.close) {
            report_.closing = ClosingReport{*asked_.traversal.box.close};
        }
    }
    void emit(const PartStore& parts, const Weld& weld) {
        emit_mesh(parts, weld, layout_, sink_, progress_);
        report_.vertices = weld.vertices();
        report_.triangles = weld.triangles();
    }
    void emit_contours(const Weld& weld, const TraversalBudget& budget) {
        const AttributeChoice& attributes = asked_.traversal.attributes;
        PartStore lines(scratch_, {1, 1, 1}, {0, 0, 0}, budget.cache / 2, attributes.width());
        contour_lines(
            *parts_, weld, asked_.contours, attributes, budget.part_vertices,
            [&](std::uint64_t order, const MeshPart& part) { lines.append(order, part); },
            progress_);
        lines.seal();
        emit(lines, Weld(lines, scratch_));
        report_.value_rounding += contour_rounding(asked_.contours, attributes);
    }
    void run_stages(const std::vector<Stage*>& stages, std::shared_ptr<ScratchMesh> whole) {
        report_.scratch_bytes += whole->bytes();
        StageMesh mesh(std::move(whole));
        for (Stage* const stage : stages) {
            stage->run(mesh, report_);
        }
        const EmittedMesh emitted =
            emit_elements(mesh.vertices(), mesh.elements(), scratch_, sink_, progress_);
        report_.vertices = emitted.vertices;
        report_.triangles = emitted.elements;
        report_.mending.zero_area = emitted.zero_area_triangles;
    }
    void end_report() {
        if (asked_.nested_distance) {
            report_.distance->bound += most_moved(asked_);
        }
        if (asked_.product != Product::surface && asked_.product != Product::isolines) {
            report_.error_bound += report_.value_rounding;
        }
    }

    const StoreReader& store_;
    ExtractQuery asked_;
    MeshSink& sink_;
    const ExtractOptions& options_;
    Progress& progress_;
    std::filesystem::path scratch_;
    MeshLayout layout_;
    ExtractReport report_;
    std::unique_ptr<StageRow> row_;
    std::optional<PartStore> parts_;
};

/// Of several isovalues, with one traversal for all of them.
void run_together(std::span<const std::unique_ptr<Extraction>> extractions,
                  const StoreReader& store, const ExtractOptions& options, Progress& progress,
                  const std::function<void(std::size_t, const ExtractReport&)>& done) {
    const auto start = Clock::now();
    for (const auto& e : extractions) {
        e->prepare();
    }
    const ExtractQuery& asked = extractions.front()->asked();
    const TraversalBudget budget = parts_budget(store, asked, options, extractions.size());
    // While stages work on one mesh, which have all of the memory, the other parts wait.
    const bool has_room = extractions.size() == 1 || !asked.stages.any();
    Workers(budget.threads).execute([&] {
        std::vector<FoundParts> found;
        for (const auto& e : extractions) {
            found.push_back(e->begin_parts(has_room ? budget.parts / extractions.size() : 0));
        }
        find_parts(store, asked, budget, found, extractions.front()->scratch(), progress);
    });
    for (std::size_t i = 0; i < extractions.size(); ++i) {
        ExtractReport report = extractions[i]->finish(budget);
        report.seconds = std::chrono::duration<double>(Clock::now() - start).count();
        done(i, report);
    }
}

/// From a kept analysis, if there is to be one and it is fine enough; else from the store.
ExtractReport extracted(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                        const ExtractOptions& options, Progress& progress) {
    const bool is_analysed = asked.analysis_folder && asked.stages.simplifies();
    if (is_analysed) {
        if (std::optional<ExtractReport> report =
                extract_analysed(store, asked, sink, options, progress)) {
            return *report;
        }
    }
    ExtractReport report;
    const auto one = std::make_unique<Extraction>(store, std::move(asked), sink, options, progress);
    run_together({&one, 1}, store, options, progress,
                 [&](std::size_t, const ExtractReport& r) { report = r; });
    if (is_analysed) {
        report.analysis.emplace();
    }
    return report;
}

}  // namespace

ExtractReport run_extraction(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                             const ExtractOptions& options, Progress& progress) {
    if (asked.corners() != 3) {
        return extracted(store, std::move(asked), sink, options, progress);
    }
    MeasuringSink measuring(sink, options.quality);
    ExtractReport report = extracted(store, std::move(asked), measuring, options, progress);
    measuring.report(report);
    return report;
}

void run_extractions(const StoreReader& store, const ExtractQuery& asked,
                     std::span<const double> isovalues,
                     const std::function<std::unique_ptr<MeshSink>(std::size_t)>& sink,
                     const std::function<void(std::size_t, const ExtractReport&)>& done,
                     const ExtractOptions& options, Progress& progress) {
    const std::uint64_t most = isovalues_at_once(store, asked.traversal, asked.values,
                                                 options.memory, options.threads, isovalues.size());
    for (std::size_t first = 0; first < isovalues.size(); first += most) {
        const auto some =
            isovalues.subspan(first, std::min<std::size_t>(most, isovalues.size() - first));
        std::vector<std::unique_ptr<MeshSink>> sinks;
        std::vector<std::unique_ptr<MeasuringSink>> measuring(some.size());
        std::vector<std::unique_ptr<Extraction>> extractions;
        for (std::size_t i = 0; i < some.size(); ++i) {
            ExtractQuery own = asked;
            own.traversal.iso = some[i];
            sinks.push_back(sink(first + i));
            if (asked.corners() == 3) {
                measuring[i] = std::make_unique<MeasuringSink>(*sinks[i], options.quality);
            }
            extractions.push_back(std::make_unique<Extraction>(
                store, std::move(own), measuring[i] ? *measuring[i] : *sinks[i], options,
                progress));
        }
        run_together(extractions, store, options, progress,
                     [&](std::size_t i, ExtractReport report) {
                         if (measuring[i]) {
                             measuring[i]->report(report);
                         }
                         sinks[i].reset();
                         done(first + i, report);
                     });
    }
}

}  // namespace isonest::detail
