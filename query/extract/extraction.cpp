#include "query/extract/extraction.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <iterator>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "query/apart/complete_normals.h"
#include "query/apart/keep_apart.h"
#include "query/distance/traverse_within_distance.h"
#include "query/extract/combinations.h"
#include "query/extract/query_checks.h"
#include "query/extract/stages/contour_lines.h"
#include "query/extract/stages/pipeline.h"
#include "query/mesh/weld.h"
#include "query/ranks/cube_shares.h"
#include "query/ranks/mesh_on_ranks.h"
#include "query/traverse/planar.h"
#include "query/values/label_view.h"
#include "store/base/workers.h"

namespace isonest::detail {

// The error indicators are saturated, so a smaller error gives at least as many triangles, with few
// exceptions. The search starts with large errors, whose meshes are cheap to make: all tries
// together cost a few times as much as the result, independent of the volume's size.

namespace {

/// A mesh with at least this fraction of the requested triangles is good enough.
constexpr double kNearBudget = 0.9;
constexpr int kMaxErrorTries = 7;  ///< between an error that is too small and one that is not
constexpr double kStep = 4;        ///< from one error to the next
/// Relative to the data's range: the next smaller error is 0.
constexpr double kMin = 1e-7;

/// Counts a mesh's elements without storing it.
class CountingSink : public MeshSink {
  public:
    explicit CountingSink(const MeshSink& like) : like_(like) {}
    void begin(const MeshLayout& layout) override { elements_ = layout.elements; }
    void add_vertices(const VertexBatch& /*batch*/) override {}
    void add_elements(const ElementBatch& /*batch*/) override {}
    [[nodiscard]] bool concurrent() const override { return true; }
    [[nodiscard]] bool holds_float64() const override { return like_.holds_float64(); }
    [[nodiscard]] std::uint64_t elements() const { return elements_; }

  private:
    const MeshSink& like_;
    std::uint64_t elements_ = 0;
};

}  // namespace

ExtractReport extract_within_triangle_budget(const Store& store, const SurfaceQuery& query,
                                             MeshSink& sink, const ExtractOptions& options,
                                             Progress& progress) {
    const TriangleBudgetByError budget = std::get<TriangleBudgetByError>(query.stop);
    if (budget.most == 0) {
        throw Error(ErrorKind::invalid_argument, "the number of triangles must be positive");
    }
    const double range = std::max(store.max_value() - store.min_value(), 0.0);
    SurfaceQuery tried = query;
    tried.stages.manifold = false;  // it does not change the number of triangles
    ExtractReport report;
    const Effort effort = effort_of(features_of(store.reader(), query));
    if (effort == Effort::none && !query.grid.cells) {
        tried.grid.cells = Cells::tetrahedra;  // also with an error of 0
    }
    const auto stop_within = [&](double error) {
        // What is tried is the error of the store's rounded values.
        tried.stop = ErrorBound{error > 0 ? error + tolerance_of(store.reader()) : 0, false,
                                budget.indicator};
        tried.effort = error > 0 ? effort : Effort::none;
    };
    const auto triangles = [&](double error) {
        stop_within(error);
        CountingSink counter(sink);
        report = extract(store, tried, counter, options, progress);
        return counter.elements();
    };
    double enough = 2 * range;
    if (const std::uint64_t least = triangles(enough); least > budget.most) {
        throw Error(ErrorKind::limit, {store.path().string()},
                    fmt::format("the coarsest mesh of this surface, within {:.4g} of the isovalue, "
                                "has {} triangles, more than {}",
                                report.error_bound, least, budget.most));
    }
    double too_small = -1;  // none so far
    std::uint64_t count = 0;
    while (too_small < 0 && enough > 0) {
        const double step = enough / kStep;
        const double next = step > kMin * range ? step : 0;
        const std::uint64_t n = triangles(next);
        if (n > budget.most) {
            too_small = next;
        } else {
            enough = next;
            count = n;
        }
    }
    for (int i = 0; i < kMaxErrorTries && too_small >= 0 &&
                    static_cast<double>(count) < kNearBudget * static_cast<double>(budget.most);
         ++i) {
        const double middle = too_small > 0 ? std::sqrt(too_small * enough) : enough / kStep;
        const std::uint64_t n = triangles(middle);
        if (n > budget.most) {
            too_small = middle;
        } else {
            enough = middle;
            count = n;
        }
    }
    stop_within(enough);
    tried.stages.manifold = query.stages.manifold;
    report = extract(store, tried, sink, options, progress);
    report.within_budget = true;
    return report;
}

namespace {

using Clock = std::chrono::steady_clock;

std::vector<double> isovalues_of(std::span<const PartsPlace> places) {
    std::vector<double> isovalues;
    std::transform(places.begin(), places.end(), std::back_inserter(isovalues),
                   [](const PartsPlace& p) { return p.iso; });
    return isovalues;
}

double elapsed_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
}

/// The sum over all ranks.
TraversalResult of_all(Communicator& ranks, const TraversalResult& own) {
    std::array sums{own.counts.visited, own.counts.leaves, own.counts.bricks, own.chunks_read,
                    own.bytes_read};
    std::array largest{own.counts.stopped_at, own.counts.value_rounding.at_edges,
                       own.counts.value_rounding.at_cuts, own.counts.height_rounding,
                       static_cast<double>(own.peak_cache_bytes)};
    ranks.sum(sums);
    ranks.largest(largest);
    return {{sums[0], sums[1], sums[2], largest[0], {largest[1], largest[2]}, largest[3]},
            sums[3],
            sums[4],
            static_cast<std::uint64_t>(largest[4]),
            own.has_missing};
}

}  // namespace

PartsTraversal::PartsTraversal(const StoreReader& store, const ExtractQuery& asked,
                               const MemoryShare& memory, std::uint64_t isovalues)
    : store_(store), asked_(asked) {
    const TraversalHeap heap = asked.heap(store.layout());
    if (!asked.nested_distance) {
        budget_ = heap.share(memory, store.is_remote(), true, isovalues);
        return;
    }
    // Threads of a traversal within a distance need additional heap.
    const std::uint64_t each = distance_traversal_heap(store.layout(), asked.traversal.bound);
    const std::uint64_t count = std::clamp<std::uint64_t>(
        memory.bytes() / 2 / each, 1, static_cast<std::uint64_t>(memory.threads()));
    budget_ = heap.share(memory.with_threads(static_cast<int>(count)).without(each * count),
                         store.is_remote(), true, isovalues);
}

/// Maximum distance of the leaves' triangles from the surface at full resolution, which may be
/// mended after they are measured. Throws Error{limit} if nothing is left of the requested
/// distance.
double PartsTraversal::nested_limit() const {
    // Rounding moves by half a unit in the last place, mending by up to four; in addition, sheets
    // are separated.
    MeshPlace place = asked_.place(store_.layout().header().nodes);
    place.rounding =
        9 * asked_.coordinate_rounding +
        (asked_.moves_apart ? kMaxApart * step_apart(asked_.coordinate_rounding, asked_.min_apart)
                            : 0);
    return distance_left(store_.path().string(), *asked_.nested_distance, place.max_moved());
}

/// For each isovalue. Surfaces are found in one traversal; others are traversed one after another,
/// with a common cache. `query`: of the query, with the cache of the vertex values. `curved`: null
/// unless the grid is curvilinear.
std::vector<TraversalCounts> PartsTraversal::all_counts(
    ChunkCache& cache, const TraversalQuery& query, std::span<const PartsPlace> places,
    const ScratchFolder& scratch, const CurvedPlace* curved, Progress& progress) const {
    std::vector<PartSink> sinks;
    for (const PartsPlace& place : places) {
        sinks.emplace_back([parts = place.parts, curved](std::uint64_t order, MeshPart&& part) {
            if (curved != nullptr) {
                curved->place(part);
            }
            parts->append(order, part);
        });
    }
    const bool is_planar = asked_.product == Product::graph || asked_.product == Product::isolines;
    if (!is_planar && !asked_.nested_distance) {
        return traverse_isovalues(cache, query, isovalues_of(places), budget_.part_vertices, sinks,
                                  progress);
    }
    std::vector<TraversalCounts> counts;
    for (std::size_t i = 0; i < places.size(); ++i) {
        TraversalQuery own = query;
        own.iso = places[i].iso;
        TraversalRun run(cache, own, budget_.part_vertices, sinks[i], progress);
        counts.push_back(is_planar ? traverse_planar(run, asked_.product == Product::graph
                                                              ? PlanarKind::graph
                                                              : PlanarKind::isolines)
                                   : traverse_within_distance(run, nested_limit(), scratch));
    }
    return counts;
}

std::vector<FoundParts> PartsTraversal::find(std::span<const PartsPlace> places,
                                             const ScratchFolder& scratch, Progress& progress,
                                             RankTeam* team) const {
    TraversalQuery query = asked_.traversal;
    query.waiting_lists = budget_.waiting;
    std::optional<ChunkCache> others;
    if (asked_.values != nullptr) {
        others.emplace(*asked_.values, budget_.values_cache);
        query.attribute_values = &*others;
    }
    std::optional<LabelView> label;
    if (asked_.label) {
        label.emplace(store_, asked_.label->id, asked_.label->within->first,
                      asked_.label->within->second);
    }
    const ChunkSource& source = label ? static_cast<const ChunkSource&>(*label) : store_;
    ChunkCache cache(source, budget_.cache,
                     query.attributes.width() > 0 ? NodeSampler::kSides : ChunkSides{});
    std::optional<ChunkCache> positions;
    std::optional<CurvedPlace> curved;
    if (store_.layout().header().curved) {
        positions.emplace(store_, budget_.values_cache);
        curved.emplace(*positions, asked_.placing());
    }
    if (team != nullptr) {
        query.share = share_of(team->ranks, source, query.box, query.plane, isovalues_of(places));
    }
    const auto start = Clock::now();
    const std::vector<TraversalCounts> counts =
        all_counts(cache, query, places, scratch, curved ? &*curved : nullptr, progress);
    const auto with_positions = [&](std::uint64_t (ChunkCache::*count)() const) {
        return (cache.*count)() + (positions ? ((*positions).*count)() : 0);
    };
    if (team != nullptr) {
        ++team->work.traversals;
        team->work.traversal_seconds += elapsed_since(start);
        team->work.chunks_read += with_positions(&ChunkCache::chunks_read);
        team->work.bytes_read += with_positions(&ChunkCache::bytes_read);
    }
    std::vector<FoundParts> found;
    for (std::size_t i = 0; i < places.size(); ++i) {
        FoundParts& one = found.emplace_back();
        one.traversal = {counts[i], with_positions(&ChunkCache::chunks_read),
                         with_positions(&ChunkCache::bytes_read),
                         with_positions(&ChunkCache::peak_bytes), store_.has_missing()};
        if (team == nullptr) {
            places[i].parts->seal();
            continue;
        }
        team->work.leaves += counts[i].leaves;
        one.traversal = of_all(team->ranks, one.traversal);
        const auto before = Clock::now();
        const SettledParts settled =
            settle_parts(team->ranks, *places[i].parts, places[i].may_stay);
        one.stay = settled.stay;
        team->work.parts_bytes += settled.bytes;
        team->work.gathering_seconds += elapsed_since(before);
    }
    return found;
}

Extraction::Extraction(ExtractedVolume volume, ExtractQuery asked, MeshSink& sink,
                       const ExtractOptions& options, Progress& progress)
    : volume_(std::move(volume)),
      asked_(std::move(asked)),
      sink_(sink),
      memory_(memory_of(options, volume_.name)),
      team_(options.team),
      progress_(progress),
      scratch_(ScratchFolder::metered(options.scratch)),
      layout_(layout_of(asked_.traversal.attributes, asked_.corners(), volume_.header.unit,
                        volume_.header.frame)) {}

void Extraction::prepare(std::vector<std::filesystem::path> inputs) {
    if (asked_.values != nullptr) {
        inputs.push_back(asked_.values->path());
    }
    sink_.prepare(layout_, inputs);
    pipeline_ = std::make_unique<Pipeline>(asked_, volume_.store, memory_, team_);
}

PartsPlace Extraction::begin_parts(std::uint64_t memory) {
    parts_.emplace(scratch_, asked_.steps, asked_.origin, memory,
                   asked_.traversal.attributes.width());
    asked_.watch(*parts_);
    PartsPlace place{asked_.traversal.iso, &*parts_};
    if (team_ != nullptr && team_->ranks.size() > 1) {
        place.may_stay = [this] { return goes_straight(); };
    }
    return place;
}

/// Whether the mesh as a whole is not changed, and can be written by all ranks.
bool Extraction::goes_straight() const {
    const bool has_missing = volume_.store != nullptr && volume_.store->has_missing();
    return asked_.product != Product::contours && !asked_.rotation && is_written_by_all(sink_) &&
           parts_->without_normal() == 0 && pipeline_->with_work(*parts_, has_missing).empty();
}

ExtractReport Extraction::finish(const FoundParts& found, const TraversalBudget& budget) {
    ReportSum report(asked_, volume_.store, volume_.header.nodes, found.traversal);
    std::vector<Stage*> stages;
    std::shared_ptr<ScratchMesh> whole;
    Workers(budget.threads).execute([&] {
        if (found.stay) {
            make_on_ranks(report);
            return;
        }
        progress_.check();
        const Weld weld(*parts_, scratch_);
        keep_apart(weld, report);
        stages = pipeline_->with_work(*parts_, found.traversal.has_missing);
        if (!stages.empty()) {
            whole = std::make_shared<ScratchMesh>(scratch_);
            move_mesh(*parts_, weld, layout_, *whole, progress_);
        } else if (asked_.product == Product::contours) {
            emit_contours(weld, budget, report);
        } else {
            complete_normals(*parts_, weld, layout_, scratch_, progress_);
            emit(*parts_, weld, report);
        }
    });
    parts_.reset();
    if (whole) {
        Workers(pipeline_->threads()).execute([&] {
            run_stages(stages, std::move(whole), report);
        });
    }
    return timed(report.sum(scratch_.meter()->peak()), start_);
}

void Extraction::make_on_ranks(ReportSum& report) {
    std::optional<ApartRange> apart;
    if (asked_.keeps_apart()) {
        apart = within_faces(asked_.apart_range(), report.place());
    }
    const MeshOnRanks mesh =
        mesh_on_ranks(*team_, *parts_, apart, layout_, sink_, scratch_, progress_);
    if (apart) {
        report.add(apart_result(mesh.apart, asked_.steps));
    }
    report.add(EmittedMesh{mesh.vertices, mesh.triangles});
}

void Extraction::keep_apart(const Weld& weld, ReportSum& report) {
    if (asked_.keeps_apart() && !parts_->is_to_be_mended()) {
        const ApartRange range = within_faces(asked_.apart_range(), report.place());
        report.add(apart_result(keep_parts_apart(*parts_, weld, range, scratch_, progress_),
                                asked_.steps));
    }
}

void Extraction::emit(const PartStore& parts, const VertexNumbers& weld, ReportSum& report) {
    emit_mesh(parts, weld, layout_, sink_, progress_);
    report.add(EmittedMesh{weld.vertices(), weld.triangles()});
}

void Extraction::emit_contours(const VertexNumbers& weld, const TraversalBudget& budget,
                               ReportSum& report) {
    const AttributeChoice& attributes = asked_.traversal.attributes;
    PartStore lines(scratch_, LatticeSteps(), {0, 0, 0}, budget.cache / 2, attributes.width());
    contour_lines(
        *parts_, weld, asked_.contours, attributes, budget.part_vertices,
        [&](std::uint64_t order, const MeshPart& part) { lines.append(order, part); }, progress_);
    lines.seal();
    emit(lines, Weld(lines, scratch_), report);
    report.add(StageResult{.value_moved = contour_rounding(asked_.contours, attributes)});
}

void Extraction::run_stages(const std::vector<Stage*>& stages, std::shared_ptr<ScratchMesh> whole,
                            ReportSum& report) {
    StageMesh mesh(std::move(whole));
    for (Stage* const stage : stages) {
        report.add(stage->run(mesh, {volume_.name, report.place(), scratch_, progress_}));
    }
    complete_normals(mesh.growing(), mesh.elements(), scratch_, progress_);
    report.add(emit_elements(mesh.vertices(), mesh.elements(), scratch_, sink_, progress_));
}

}  // namespace isonest::detail
