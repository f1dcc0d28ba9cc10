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

#include "query/extract/analysis/extract_analysed.h"
#include "query/extract/find_parts.h"
#include "query/extract/stages/contour_lines.h"
#include "query/extract/stages/distance_limits.h"
#include "query/extract/stages/stage_row.h"
#include "query/mesh/border_count.h"
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
          layout_(layout_of(asked_.traversal.attributes, asked_.corners())) {}

    ExtractReport run() {
        const auto start = Clock::now();
        prepare();
        const StageRow row({store_, asked_, options_, scratch_, progress_});
        const TraversalBudget budget = parts_budget(store_, asked_, options_);
        begin_report();
        Workers(budget.threads).execute([&] {
            parts_.emplace(scratch_, asked_.spacing, asked_.origin, budget.parts,
                           asked_.traversal.attributes.width());
            find_parts(store_, asked_, budget, *parts_, scratch_, report_, progress_);
            progress_.check();
            const Weld weld(*parts_, scratch_);
            if (row.has_work(*parts_)) {
                whole_ = std::make_shared<ScratchMesh>(scratch_);
                emit_mesh(*parts_, weld, layout_, *whole_, progress_);
            } else if (asked_.product == Product::contours) {
                emit_contours(weld, budget);
            } else {
                emit(*parts_, weld);
            }
        });
        if (whole_) {
            Workers(row.threads()).execute([&] { run_stages(row); });
        }
        end_report();
        report_.seconds = std::chrono::duration<double>(Clock::now() - start).count();
        return report_;
    }

  private:
    void prepare() {
        std::vector<std::filesystem::path> inputs{store_.path()};
        if (asked_.values != nullptr) {
            inputs.push_back(asked_.values->path());
        }
        sink_.prepare(layout_, inputs);
    }
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
    void run_stages(const StageRow& row) {
        report_.scratch_bytes += whole_->bytes();
        StageMesh mesh(std::move(whole_));
        row.run(*parts_, mesh, report_);
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
    std::optional<PartStore> parts_;
    std::shared_ptr<ScratchMesh> whole_;
};

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
    ExtractReport report = Extraction(store, std::move(asked), sink, options, progress).run();
    if (is_analysed) {
        report.analysis.emplace();
    }
    return report;
}

}  // namespace

ExtractReport run_extraction(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                             const ExtractOptions& options, Progress& progress) {
    if (!options.quality || asked.corners() != 3) {
        return extracted(store, std::move(asked), sink, options, progress);
    }
    MeasuringSink measuring(sink);
    ExtractReport report = extracted(store, std::move(asked), measuring, options, progress);
    report.quality = measuring.quality();
    return report;
}

}  // namespace isonest::detail
