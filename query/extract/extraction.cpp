#include "query/extract/extraction.h"

#include <algorithm>
#include <utility>

#include "query/apart/complete_normals.h"
#include "query/apart/parts_apart.h"
#include "query/extract/stages/apart_stage.h"
#include "query/extract/stages/contour_lines.h"
#include "query/extract/stages/distance_limits.h"
#include "query/mesh/emit_mesh.h"
#include "query/ranks/mesh_on_ranks.h"
#include "store/base/workers.h"

namespace isonest::detail {

Extraction::Extraction(StagedVolume volume, ExtractQuery asked, MeshSink& sink,
                       const ExtractOptions& options, Progress& progress)
    : volume_(std::move(volume)),
      asked_(std::move(asked)),
      sink_(sink),
      options_(options),
      progress_(progress),
      scratch_(ScratchFolder::metered(options.scratch)),
      layout_(layout_of(asked_.traversal.attributes, asked_.corners(), volume_.header.unit,
                        volume_.header.frame)) {}

void Extraction::prepare(std::vector<std::filesystem::path> inputs) {
    if (asked_.values != nullptr) {
        inputs.push_back(asked_.values->path());
    }
    sink_.prepare(layout_, inputs);
    row_ = std::make_unique<StageRow>(StageSetting{volume_, asked_, options_, scratch_, progress_});
    begin_report();
}

FoundParts Extraction::begin_parts(std::uint64_t memory) {
    parts_.emplace(scratch_, asked_.spacing, asked_.origin, memory,
                   asked_.traversal.attributes.width());
    watch_vertices(asked_, *parts_);
    FoundParts found{asked_.traversal.iso, &*parts_, &report_};
    if (options_.team != nullptr && options_.team->ranks.size() > 1) {
        found.may_stay = [this] { return goes_straight(); };
    }
    return found;
}

/// Whether nothing happens to the mesh as a whole, and all ranks can write it.
bool Extraction::goes_straight() const {
    return asked_.product != Product::contours && !asked_.turn && is_written_by_all(sink_) &&
           parts_->without_normal() == 0 && row_->with_work(*parts_).empty();
}

ExtractReport Extraction::finish_on_ranks(const TraversalBudget& budget) {
    Workers(budget.threads).execute([&] {
        const MeshOnRanks mesh =
            mesh_on_ranks(*options_.team, *parts_,
                          asked_.keeps_apart() ? std::optional(apart_range(asked_)) : std::nullopt,
                          layout_, sink_, scratch_, progress_);
        if (asked_.keeps_apart()) {
            count_apart(mesh.apart, asked_, report_);
        }
        report_.vertices = mesh.vertices;
        report_.triangles = mesh.triangles;
    });
    parts_.reset();
    end_report();
    return report_;
}

ExtractReport Extraction::finish(const TraversalBudget& budget) {
    std::vector<Stage*> stages;
    std::shared_ptr<ScratchMesh> whole;
    Workers(budget.threads).execute([&] {
        progress_.check();
        const Weld weld(*parts_, scratch_);
        if (asked_.keeps_apart() && !parts_->is_to_be_mended()) {
            count_apart(keep_parts_apart(*parts_, weld, apart_range(asked_), scratch_, progress_),
                        asked_, report_);
        }
        stages = row_->with_work(*parts_);
        if (!stages.empty()) {
            whole = std::make_shared<ScratchMesh>(scratch_);
            move_mesh(*parts_, weld, layout_, *whole, progress_);
        } else if (asked_.product == Product::contours) {
            emit_contours(weld, budget);
        } else {
            complete_normals(*parts_, weld, layout_, scratch_, progress_);
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

void Extraction::begin_report() {
    report_.tolerance = asked_.threshold;
    report_.coordinate_rounding = asked_.coordinate_rounding;
    if (const StoreReader* const store = volume_.store; store != nullptr) {
        report_.dimension = store->layout().lattice().dimension();
        const StoreReader& values = asked_.values != nullptr ? *asked_.values : *store;
        report_.value_range = std::max(values.max_value() - values.min_value(), 0.0);
        report_.traversal.chunks_total = store->layout().rows();
    }
    report_.traversal.cells = asked_.traversal.cells;
    report_.traversal.stop = asked_.traversal.stop;
    report_.traversal.bound = asked_.traversal.bound;
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

void Extraction::emit(const PartStore& parts, const VertexNumbers& weld) {
    emit_mesh(parts, weld, layout_, sink_, progress_);
    report_.vertices = weld.vertices();
    report_.triangles = weld.triangles();
}

void Extraction::emit_contours(const VertexNumbers& weld, const TraversalBudget& budget) {
    const AttributeChoice& attributes = asked_.traversal.attributes;
    PartStore lines(scratch_, {1, 1, 1}, {0, 0, 0}, budget.cache / 2, attributes.width());
    contour_lines(
        *parts_, weld, asked_.contours, attributes, budget.part_vertices,
        [&](std::uint64_t order, const MeshPart& part) { lines.append(order, part); }, progress_);
    lines.seal();
    emit(lines, Weld(lines, scratch_));
    report_.value_rounding += contour_rounding(asked_.contours, attributes);
}

void Extraction::run_stages(const std::vector<Stage*>& stages, std::shared_ptr<ScratchMesh> whole) {
    StageMesh mesh(std::move(whole));
    for (Stage* const stage : stages) {
        stage->run(mesh, report_);
    }
    complete_normals(mesh.growing(), mesh.elements(), scratch_, progress_);
    const EmittedMesh emitted =
        emit_elements(mesh.vertices(), mesh.elements(), scratch_, sink_, progress_);
    report_.vertices = emitted.vertices;
    report_.triangles = emitted.elements;
    report_.mending.zero_area = emitted.zero_area_triangles;
}

void Extraction::end_report() {
    report_.scratch_bytes = scratch_.meter()->peak();
    if (asked_.nested_distance) {
        report_.distance->bound += most_moved(asked_);
    }
    if (asked_.product != Product::surface && asked_.product != Product::isolines) {
        report_.error_bound += report_.value_rounding;
    }
}

}  // namespace isonest::detail
