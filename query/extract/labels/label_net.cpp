#include "query/extract/labels/label_net.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "query/apart/manifold_sink.h"
#include "query/extract/combinations.h"
#include "query/extract/query_checks.h"
#include "query/extract/report.h"
#include "query/mesh/components.h"
#include "query/mesh/measuring_sink.h"
#include "query/mesh/mesh_sinks.h"
#include "query/mesh/scratch_mesh.h"
#include "query/mesh/vertex_stars.h"
#include "query/statistics/find_labels.h"
#include "query/surface_nets/make_net.h"
#include "query/surface_nets/net_mesh.h"
#include "store/base/memory.h"
#include "store/base/vectors.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

/// A number that is not a label of the store.
std::int64_t outside_of(const StoreReader& store) {
    const double least = store.min_value();
    if (store.layout().header().labels || !(least < 0)) {
        return -1;
    }
    return static_cast<std::int64_t>(std::floor(least)) - 1;
}

}  // namespace

double net_rounding(const StoreHeader& header) {
    const LatticeSteps steps = header.steps();
    const Double3 half = steps.vector({0.5, 0.5, 0.5});
    Double3 first = header.origin;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        first[axis] -= half[axis];
    }
    const double own = coordinate_rounding(header.nodes + Int3{1, 1, 1}, steps, first);
    const Directions rotation = header.rotation();
    if (rotation == kAlongWorld) {
        return own;
    }
    double largest = 0;
    for (unsigned corner = 0; corner < 8; ++corner) {
        Double3 p{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const auto n = static_cast<double>(header.nodes[static_cast<int>(axis)]);
            p[axis] = (corner >> axis & 1U) != 0 ? n : 0;
        }
        p = steps.vector(p);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            p[axis] = first[axis] + p[axis];
        }
        for (const double x : rotated_about(header.origin, rotation, p)) {
            largest = std::max(largest, std::fabs(x));
        }
    }
    const auto most = static_cast<float>(largest);
    const double step =
        static_cast<double>(std::nextafter(most, std::numeric_limits<float>::max())) -
        static_cast<double>(most);
    if (steps.is_sheared()) {
        return own + steps.max_steps({step / 2, step / 2, step / 2});
    }
    return own + std::sqrt(3.0) * step / 2 / steps.shortest();
}

SmoothChoice smooth_choice(const StoreReader& store, const LabelQuery& query,
                           std::optional<Feature> feature) {
    const StoreHeader& header = store.layout().header();
    const std::string name = store.path().string();
    Features features = features_of(store, query);
    if (feature) {
        features.set(static_cast<std::size_t>(*feature));
    }
    require_combination(features, name);
    require_simplifiable(query.effort, query.stop.has_value());
    if (query.stages.manifold && feature) {
        throw Error(
            ErrorKind::invalid_argument, {name},
            fmt::format(
                "{} cannot be made a manifold: {}",
                feature == Feature::interfaces ? "interfaces of labels" : "levels of detail",
                feature == Feature::interfaces ? "several surfaces meet in their edges"
                                               : "their meshes are cut into cells"));
    }
    SmoothChoice choice{*query.smooth, query.stages.close, query.stages.components};
    choice.manifold = query.stages.manifold;
    if (query.stop) {
        std::visit([](const auto& stop) { require_distance(stop); }, *query.stop);
        const auto* const bound = std::get_if<DistanceBound>(&*query.stop);
        if (bound == nullptr || bound->value != 0) {
            choice.distance =
                distance_choice(header, *query.stop, query.effort.value_or(Effort::best));
        }
    }
    if (choice.components) {
        require_components(*choice.components);
    }
    const int passes = choice.smoothing.passes;
    if (passes < 0 || passes > LabelSmoothing::kMaxPasses) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("smooth {}: give a number of passes from 0 to {}", passes,
                                LabelSmoothing::kMaxPasses));
    }
    const double rounding = net_rounding(header);
    constexpr double kMax = 0.5 - static_cast<double>(kMaxMoved);
    if (!(rounding < kMax)) {
        throw Error(
            ErrorKind::limit, {name},
            fmt::format("32-bit floats round its coordinates by up to {:.6g} of the node distance; "
                        "smooth labels allow at most {:.6g}. It is too far from 0",
                        rounding, kMax),
            {{RemedyKind::place_in_world, "origin"}});
    }
    return choice;
}

LabelNet::LabelNet(const StoreReader& store, std::span<const Label> labels,
                   const SmoothChoice& choice, const ExtractOptions& options, const NetUse& use,
                   Progress& progress)
    : store_(store),
      choice_(choice),
      with_quality_(options.quality),
      rounding_(net_rounding(store.layout().header())),
      outside_(outside_of(store)),
      scratch_(ScratchFolder::metered(options.scratch)),
      is_simplified_(choice.distance.has_value()) {
    const StoreHeader& header = store.layout().header();
    const bool sides = use.interfaces || use.details || is_simplified_;
    layout_.unit = header.unit;
    layout_.frame = header.frame;
    Int3 lo = header.nodes;
    Int3 hi{};
    for (const Label& label : labels) {
        wanted_.push_back(label.id);
        const auto [from, to] = cells_of_label(label);
        lo = min(lo, from);
        hi = max(hi, to);
    }
    if (labels.empty()) {
        lo = {0, 0, 0};
        hi = {1, 1, 1};
    }
    const NetSetting setting{header.nodes,
                             header.steps(),
                             header.origin,
                             choice.smoothing.passes,
                             choice.close.has_value(),
                             wanted_,
                             sides};
    // The list above, and the caller's copy.
    const std::uint64_t lists =
        labels.size() * (sizeof(std::int64_t) + sizeof(Label) + sizeof(std::size_t));
    const MemoryShare memory = memory_of(options, store.path().string()).without(lists);
    const std::uint64_t each =
        kNetMeshHeap + ManifoldSink::kHeap + (use.details ? use.details->heap : 0);
    if (use.details) {
        memory.require(each, "packing the meshes of its labels");
    }
    const NetPlan plan = net_plan(setting, store.layout().array(0, Field::values), lo, hi, memory);
    net_.emplace(scratch_, ceil_div(setting.cells(), kPieceCells), sides);
    counts_ = make_net(store, setting, plan, labels, *net_, progress);
    if (is_simplified_ || use.details) {
        sheets_.emplace(
            *net_,
            SheetSetting{header, choice.distance, choice.smoothing.keep_nodes, memory, options.team,
                         wanted_, outside_, rounding_ * header.steps().diagonal(),
                         store.path().string(), use.details},
            scratch_, progress);
    }
    static_assert(SheetOutput::kHeap <= kNetMeshHeap);
    threads_ = static_cast<int>(std::clamp<std::uint64_t>(
        memory.left() / each, 1, static_cast<std::uint64_t>(memory.threads())));
}

/// Measures and rotates a mesh on its way to its sink; `emit` outputs it.
ExtractReport LabelNet::emit_measured(MeshSink& sink, Axes axes,
                                      const std::function<LabelMesh(MeshSink&)>& emit) const {
    const StoreHeader& header = store_.layout().header();
    MeasuringSink measuring(sink, with_quality_);
    std::optional<RotatedSink> turning;
    if (const Directions rotation = header.rotation();
        axes == Axes::world && rotation != kAlongWorld) {
        turning.emplace(measuring, header.origin, rotation);
    }
    LabelMesh mesh = emit(turning ? static_cast<MeshSink&>(*turning) : measuring);
    if (turning) {
        mesh.net.no_area = turning->zero_area_triangles();
    }
    if (is_simplified_) {
        mesh.within_budget = sheets_->within_budget();
    }
    return measured(smoothed({store_, choice_.smoothing, choice_.close, counts_, rounding_},
                             std::move(mesh), scratch_.meter()->peak()),
                    measuring);
}

/// The same for the mesh of a label, where it touches itself. Labels are made at the same time, so
/// each counts alone.
ExtractReport LabelNet::emit_counted(MeshSink& sink, Axes axes, const Progress& progress,
                                     const std::function<LabelMesh(MeshSink&)>& emit) const {
    ManifoldSink counting(sink,
                          choice_.manifold ? TouchingSheets::separated : TouchingSheets::counted,
                          scratch_, progress);
    ExtractReport report = with_manifold(emit_measured(counting, axes, emit), counting);
    report.scratch_bytes = scratch_.meter()->peak();
    return report;
}

/// Outputs a label's mesh without the dropped components to a sink. The others have the same
/// vertices and triangles as with all components; if all are kept, it is the same mesh.
LabelMesh LabelNet::emit_kept(std::int64_t label, MeshSink& sink, const Progress& progress) const {
    LabelProgress silent(progress);
    ScratchMesh whole(scratch_);
    LabelMesh mesh{emit_net_mesh(*net_, label, layout_, whole, progress)};
    KeptComponents kept(whole, *choice_.components, scratch_, silent);
    mesh.components = kept.report();
    if (kept.report().dropped == 0) {
        mesh.net = emit_net_mesh(*net_, label, layout_, sink, progress);
        return mesh;
    }
    const EmittedMesh emitted = emit_elements(whole, kept.corners(), scratch_, sink, silent);
    mesh.net.vertices = emitted.vertices;
    mesh.net.triangles = emitted.elements;
    mesh.net.no_area = emitted.zero_area_triangles;
    return mesh;
}

/// Also measures the whole label.
LabelMesh LabelNet::emit_simplified(std::size_t number, MeshSink& sink,
                                    const Progress& progress) const {
    LabelMesh mesh{sheets_->emit_label(number, 0, layout_, sink, progress)};
    mesh.distance = sheets_->distance();
    CallbackSink nowhere({}, {});
    MeasuringSink full(nowhere, false);
    mesh.distance->full_triangles =
        emit_net_mesh(*net_, wanted_[number], layout_, full, progress).triangles;
    mesh.distance->full = full.measures();
    for (const auto& [other, area] : sheets_->areas(number)) {
        if (other != outside_) {
            mesh.neighbours.push_back({other, area});
        }
    }
    return mesh;
}

ExtractReport LabelNet::emit_label(std::size_t number, MeshSink& sink, const Progress& progress,
                                   Axes axes) const {
    const std::int64_t label = wanted_[number];
    return emit_counted(sink, axes, progress, [&](MeshSink& to) {
        if (is_simplified_) {
            return emit_simplified(number, to, progress);
        }
        LabelMesh mesh = choice_.components
                             ? emit_kept(label, to, progress)
                             : LabelMesh{emit_net_mesh(*net_, label, layout_, to, progress)};
        for (const SharedArea& shared : net_->shared(label)) {
            mesh.neighbours.push_back({shared.other, shared.area});
        }
        return mesh;
    });
}

ExtractReport LabelNet::write_label(std::size_t number, MeshSink& sink,
                                    const Progress& progress) const {
    const std::filesystem::path& input = store_.path();
    sink.prepare(layout_, std::span(&input, 1));
    return emit_label(number, sink, progress);
}

std::uint64_t LabelNet::triangles(std::size_t number, int level) const {
    if (level > 0 || is_simplified_) {
        return sheets_->triangles(number, level);
    }
    std::uint64_t triangles = 0;
    for (const LabelPartRecord& part : net_->parts(wanted_[number])) {
        triangles += 2 * std::uint64_t{part.quads};
    }
    return triangles;
}

ExtractReport LabelNet::emit_interfaces(MeshSink& sink, const Progress& progress) const {
    return emit_measured(sink, Axes::world, [&](MeshSink& to) {
        if (!is_simplified_) {
            return LabelMesh{emit_net_interfaces(*net_, outside_, layout_, to, progress)};
        }
        LabelMesh mesh{sheets_->emit_all(layout_, to, progress)};
        mesh.distance = sheets_->distance();
        return mesh;
    });
}

void LabelNet::each_interface_of(const std::function<void(const SharedArea&)>& each) const {
    if (!is_simplified_) {
        each_interface(*net_, wanted_, each);
        return;
    }
    for (std::size_t i = 0; i < wanted_.size(); ++i) {
        for (const auto& [other, area] : sheets_->areas(i)) {
            if (other == outside_) {
                each({wanted_[i], kOutsideLabel, area});
            } else if (other > wanted_[i]) {
                each({wanted_[i], other, area});
            } else if (!std::binary_search(wanted_.begin(), wanted_.end(), other)) {
                each({other, wanted_[i], area});
            }
        }
    }
}

void each_label(const char* phase, int threads, std::size_t labels, Progress& progress,
                const std::function<void(std::size_t)>& work) {
    progress.begin(phase, labels, "labels");
    Workers(threads).execute([&] {
        tbb::parallel_for(
            tbb::blocked_range<std::size_t>(0, labels, 1),
            [&](const tbb::blocked_range<std::size_t>& range) {
                for (std::size_t i = range.begin(); i < range.end(); ++i) {
                    progress.check();
                    work(i);
                    progress.advance(1);
                }
            },
            tbb::simple_partitioner{});
    });
}

}  // namespace isonest::detail
