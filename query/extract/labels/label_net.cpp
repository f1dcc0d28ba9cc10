#include "query/extract/labels/label_net.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "query/extract/combinations.h"
#include "query/extract/labels/extract_labels.h"
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
#include "query/values/label_view.h"
#include "store/base/memory.h"
#include "store/base/vectors.h"
#include "store/base/workers.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

bool simplifies(const LabelQuery& query) {
    const DistanceBound* const bound =
        query.stop ? std::get_if<DistanceBound>(&*query.stop) : nullptr;
    return query.stop && (bound == nullptr || bound->value != 0);
}

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

LabelNet::LabelNet(const StoreReader& store, std::span<const Label> labels, const LabelQuery& query,
                   const ExtractOptions& options, const NetUse& use, Progress& progress)
    : store_(store),
      query_(query),
      with_quality_(options.quality),
      rounding_(net_rounding(store.layout().header())),
      outside_(outside_of(store)),
      scratch_(ScratchFolder::metered(options.scratch)),
      is_simplified_(simplifies(query)) {
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
                             query.smooth->passes,
                             query.stages.close.has_value(),
                             wanted_,
                             sides};
    // The list above, and the caller's copy.
    const std::uint64_t lists =
        labels.size() * (sizeof(std::int64_t) + sizeof(Label) + sizeof(std::size_t));
    const MemoryShare memory = memory_of(options, store.path().string()).without(lists);
    const std::uint64_t each = kNetMeshHeap + (use.details ? use.details->heap : 0);
    if (use.details) {
        memory.require(each, "packing the meshes of its labels");
    }
    const NetPlan plan = net_plan(setting, store.layout().array(0, Field::values), lo, hi, memory);
    net_.emplace(scratch_, ceil_div(setting.cells(), kPieceCells), sides);
    counts_ = make_net(store, setting, plan, labels, *net_, progress);
    if (is_simplified_ || use.details) {
        std::optional<DistanceChoice> distance;
        if (is_simplified_) {
            distance = distance_choice(header, *query.stop, query.effort.value_or(Effort::best));
        }
        sheets_.emplace(
            *net_,
            SheetSetting{header, distance, query.smooth->keep_nodes, memory, options.team, wanted_,
                         outside_, rounding_ * header.steps().diagonal(), store.path().string(),
                         use.details},
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
    return measured(smoothed({store_, *query_.smooth, query_.stages.close, counts_, rounding_},
                             std::move(mesh), scratch_.meter()->peak()),
                    measuring);
}

/// Outputs a label's mesh without the dropped components to a sink. The others have the same
/// vertices and triangles as with all components; if all are kept, it is the same mesh.
LabelMesh LabelNet::emit_kept(std::int64_t label, MeshSink& sink, const Progress& progress) const {
    LabelProgress silent(progress);
    ScratchMesh whole(scratch_);
    LabelMesh mesh{emit_net_mesh(*net_, label, layout_, whole, progress)};
    KeptComponents kept(whole, *query_.stages.components, scratch_, silent);
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
    return emit_measured(sink, axes, [&](MeshSink& to) {
        if (is_simplified_) {
            return emit_simplified(number, to, progress);
        }
        LabelMesh mesh = query_.stages.components
                             ? emit_kept(label, to, progress)
                             : LabelMesh{emit_net_mesh(*net_, label, layout_, to, progress)};
        for (const SharedArea& shared : net_->shared(label)) {
            mesh.neighbours.push_back({shared.other, shared.area});
        }
        return mesh;
    });
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

namespace {

using SmoothClock = std::chrono::steady_clock;

/// `feature`: what is requested in addition to meshes of labels.
void require_smoothable(const StoreReader& store, const LabelQuery& query,
                        std::optional<Feature> feature = {}) {
    const std::string name = store.path().string();
    Features features = features_of(store, query);
    if (feature) {
        features.set(static_cast<std::size_t>(*feature));
    }
    require_combination(features, name);
    require_simplifiable(query.effort, query.stop.has_value());
    if (query.stop) {
        std::visit([](const auto& stop) { require_distance(stop); }, *query.stop);
    }
    if (query.stages.components) {
        require_components(*query.stages.components);
    }
    if (query.smooth->passes < 0 || query.smooth->passes > LabelSmoothing::kMaxPasses) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("smooth {}: give a number of passes from 0 to {}",
                                query.smooth->passes, LabelSmoothing::kMaxPasses));
    }
    const double rounding = net_rounding(store.layout().header());
    constexpr double kMax = 0.5 - static_cast<double>(kMaxMoved);
    if (!(rounding < kMax)) {
        throw Error(
            ErrorKind::limit, {name},
            fmt::format("too far from 0 for smooth labels: 32-bit floats round its coordinates by "
                        "up to {:.6g} of the node distance, but at most {:.6g} is allowed",
                        rounding, kMax),
            {{RemedyKind::place_in_world, "origin"}});
    }
}

/// The number of threads for which there is memory to search for a label, a chunk each. Throws
/// Error{limit} if there is none.
int threads_to_look(const StoreLayout& layout, const MemoryShare& memory) {
    const std::size_t chunk = layout.array(0, Field::values).chunk_bytes();
    return memory.threads_of(chunk + decode_heap(chunk), "smoothing its labels");
}

/// Calls `work(i)` for each label of the net, with as many threads as it has memory for.
template <class Work>
void each_label(const LabelNet& net, std::size_t labels, Progress& progress, const Work& work) {
    progress.begin("write mesh", labels, "labels");
    Workers(net.threads()).execute([&] {
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

/// Outputs the mesh of a label to its sink.
ExtractReport emit_prepared(const LabelNet& net, std::size_t number, MeshSink& sink,
                            const std::filesystem::path& input, const Progress& progress) {
    sink.prepare(net.layout(), std::span(&input, 1));
    return net.emit_label(number, sink, progress);
}

/// The indices of the labels in their list, sorted by id.
std::vector<std::size_t> places_by_id(std::span<const Label> labels) {
    std::vector<std::size_t> place(labels.size());
    std::iota(place.begin(), place.end(), std::size_t{0});
    std::sort(place.begin(), place.end(),
              [&](std::size_t a, std::size_t b) { return labels[a].id < labels[b].id; });
    return place;
}

std::vector<Label> in_places(std::span<const Label> labels, std::span<const std::size_t> place) {
    std::vector<Label> sorted;
    std::transform(place.begin(), place.end(), std::back_inserter(sorted),
                   [&](std::size_t i) { return labels[i]; });
    return sorted;
}

}  // namespace

void smooth_labels(const StoreReader& store, std::span<const Label> labels, const LabelQuery& query,
                   const std::function<std::unique_ptr<MeshSink>(const Label&)>& sink,
                   const std::function<void(std::size_t number, const ExtractReport&)>& done,
                   const ExtractOptions& options, Progress& progress) {
    require_smoothable(store, query);
    if (labels.empty()) {
        return;
    }
    const std::vector<std::size_t> place = places_by_id(labels);
    const std::vector<Label> sorted = in_places(labels, place);
    const auto start = SmoothClock::now();
    const LabelNet net(store, sorted, query, options, {}, progress);
    each_label(net, sorted.size(), progress, [&](std::size_t i) {
        const std::unique_ptr<MeshSink> to = sink(sorted[i]);
        done(place[i], timed(emit_prepared(net, i, *to, store.path(), progress), start));
    });
}

void neuroglancer_labels(
    const StoreReader& store, std::span<const Label> labels, const LabelQuery& query,
    const std::filesystem::path& folder, Shards* shards,
    const std::function<void(std::size_t number, const NeuroglancerReport&)>& done,
    const ExtractOptions& options, Progress& progress) {
    const auto start = SmoothClock::now();
    require_smoothable(store, query, Feature::details);
    const StoreHeader& header = store.layout().header();
    const std::vector<std::size_t> place = places_by_id(labels);
    const std::vector<Label> sorted = in_places(labels, place);
    const LabelNet net(store, sorted, query, options, {.details = detail_setting(header)},
                       progress);
    each_label(net, sorted.size(), progress, [&](std::size_t i) {
        NeuroglancerReport report =
            write_label_details(net, header, i, sorted[i], folder, shards, progress);
        report.finest = timed(std::move(report.finest), start);
        done(place[i], report);
    });
}

ExtractReport label_interfaces(const StoreReader& store, std::span<const Label> labels,
                               const LabelQuery& query, MeshSink& sink,
                               const std::function<void(const LabelInterface&)>& each,
                               const ExtractOptions& options, Progress& progress) {
    const auto start = SmoothClock::now();
    require_smoothable(store, query, Feature::interfaces);
    MeshLayout layout;
    layout.has_sides = true;
    layout.unit = store.layout().header().unit;
    layout.frame = store.layout().header().frame;
    const std::filesystem::path& input = store.path();
    sink.prepare(layout, std::span(&input, 1));
    const std::vector<Label> sorted = in_places(labels, places_by_id(labels));
    const LabelNet net(store, sorted, query, options, {.interfaces = true}, progress);
    progress.begin("write mesh", 1, "meshes");
    InterfaceReport interfaces;
    interfaces.outside = net.outside();
    ExtractReport mesh;
    Workers(net.threads()).execute([&] { mesh = net.emit_interfaces(sink, progress); });
    net.each_interface_of([&](const SharedArea& shared) {
        ++interfaces.interfaces;
        if (each) {
            each({shared.label, has_mesh(shared.other) ? shared.other : interfaces.outside,
                  shared.area});
        }
    });
    progress.advance(1);
    return timed(with_interfaces(std::move(mesh), interfaces), start);
}

ExtractReport smooth_label(const StoreReader& store, const LabelQuery& query, MeshSink& sink,
                           const ExtractOptions& options, Progress& progress) {
    require_smoothable(store, query);
    require_label(store, query.label.id);
    std::optional<Label> label;
    if (const auto& within = query.label.within) {
        label = Label{query.label.id, 0, within->first, within->second};
    } else {
        label = find_label(
            store, query.label.id, value_of_label(store.layout().header(), query.label.id),
            threads_to_look(store.layout(), memory_of(options, store.path().string())), progress);
    }
    // For a label that does not exist, the net has no cells, and the mesh is empty.
    const Label none{query.label.id, 0, {}, {}};
    const auto start = SmoothClock::now();
    const LabelNet net(store, std::span(label ? &*label : &none, 1), query, options, {}, progress);
    ExtractReport report;
    each_label(net, 1, progress, [&](std::size_t i) {
        report = timed(emit_prepared(net, i, sink, store.path(), progress), start);
    });
    return report;
}

}  // namespace isonest::detail
