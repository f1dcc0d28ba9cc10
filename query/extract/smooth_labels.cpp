#include "query/extract/smooth_labels.h"

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
#include "query/extract/query_checks.h"
#include "query/labels/find_label.h"
#include "query/labels/label_progress.h"
#include "query/mesh/components.h"
#include "query/mesh/coordinate_rounding.h"
#include "query/mesh/measuring_sink.h"
#include "query/mesh/rotated_sink.h"
#include "query/mesh/scratch_mesh.h"
#include "query/surface_nets/make_net.h"
#include "query/surface_nets/net_mesh.h"
#include "query/view/label_view.h"
#include "store/base/memory_budget.h"
#include "store/base/rotation.h"
#include "store/base/workers.h"
#include "store/container/codec.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {
namespace {

using SmoothClock = std::chrono::steady_clock;

/// Most by which a coordinate of the meshes is rounded, in distances of neighbouring nodes: they
/// reach half such a distance beyond the nodes, and are turned if the volume is.
double rounding_of(const StoreHeader& header) {
    Double3 first = header.origin;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        first[axis] -= header.spacing[axis] / 2;
    }
    const double own = coordinate_rounding(header.nodes + Int3{1, 1, 1}, header.spacing, first);
    if (header.direction == kAlongWorld) {
        return own;
    }
    double largest = 0;
    for (unsigned corner = 0; corner < 8; ++corner) {
        Double3 p = first;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const auto n = static_cast<double>(header.nodes[static_cast<int>(axis)]);
            p[axis] += (corner >> axis & 1U) != 0 ? header.spacing[axis] * n : 0;
        }
        for (const double x : rotated_about(header.origin, header.direction, p)) {
            largest = std::max(largest, std::fabs(x));
        }
    }
    const auto most = static_cast<float>(largest);
    const double step =
        static_cast<double>(std::nextafter(most, std::numeric_limits<float>::max())) -
        static_cast<double>(most);
    const double least = *std::min_element(header.spacing.begin(), header.spacing.end());
    return own + std::sqrt(3.0) * step / 2 / least;
}

void require_smoothable(const StoreReader& store, const LabelQuery& query) {
    const std::string name = store.path().string();
    require_combination(wishes_of(store, query), name);
    if (query.stages.components) {
        require_components(*query.stages.components);
    }
    if (query.smooth->passes < 0 || query.smooth->passes > LabelSmoothing::kMostPasses) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("smooth {}: give a number of passes from 0 to {}",
                                query.smooth->passes, LabelSmoothing::kMostPasses));
    }
    const double rounding = rounding_of(store.layout().header());
    constexpr double kMost = 0.5 - static_cast<double>(kMostMoved);
    if (!(rounding < kMost)) {
        throw Error(ErrorKind::limit, {name},
                    fmt::format("32-bit floats round its coordinates by up to {:.6g} of a node's "
                                "distance; smooth labels keep all nodes on their sides with less "
                                "than {:.6g} alone. Its place is too far from 0",
                                rounding, kMost),
                    {{RemedyKind::place_in_world, "origin"}});
    }
}

/// What is the same for all labels.
struct SmoothSetting {
    const StoreReader& store;
    const LabelQuery& query;
    const ExtractOptions& options;
    MeshLayout layout;
    double rounding = 0;  ///< as of rounding_of()
};

ExtractReport begun_report(const SmoothSetting& s, const NetCounts& counts) {
    ExtractReport report;
    report.value_range = std::max(s.store.max_value() - s.store.min_value(), 0.0);
    report.coordinate_rounding = s.rounding;
    report.traversal.cells = Cells::hexahedra;
    report.traversal.bricks = counts.blocks;
    report.traversal.chunks_read = counts.chunks_read;
    report.traversal.chunks_total = s.store.layout().rows();
    report.traversal.bytes_read = counts.bytes_read;
    report.traversal.peak_cache_bytes = counts.peak_cache_bytes;
    if (s.query.stages.close) {
        report.closing = ClosingReport{*s.query.stages.close};
    }
    return report;
}

/// A label's mesh without the components that are not kept, to a sink. The others have the vertices
/// and triangles that they have with all; if all are kept, it is the same mesh.
NetMesh emit_kept(const SmoothSetting& s, const NetStore& net, std::int64_t label,
                  const ScratchFolder& scratch, MeshSink& sink, ExtractReport& report,
                  const Progress& progress) {
    LabelProgress silent(progress);
    ScratchMesh whole(scratch);
    NetMesh mesh = emit_net_mesh(net, label, s.layout, whole, progress);
    KeptComponents kept(whole, *s.query.stages.components, scratch, silent);
    report.components = ComponentReport{kept.components(), kept.dropped(), kept.dropped_elements(),
                                        kept.largest_dropped()};
    if (kept.dropped() == 0) {
        return emit_net_mesh(net, label, s.layout, sink, progress);
    }
    const EmittedMesh emitted = emit_elements(whole, kept.corners(), scratch, sink, silent);
    mesh.vertices = emitted.vertices;
    mesh.triangles = emitted.elements;
    mesh.no_area = emitted.zero_area_triangles;
    return mesh;
}

/// A label's mesh, to its sink.
ExtractReport emit_label(const SmoothSetting& s, const NetStore& net, std::int64_t label,
                         const ScratchFolder& scratch, MeshSink& sink, ExtractReport report,
                         const Progress& progress) {
    const StoreHeader& header = s.store.layout().header();
    MeasuringSink measuring(sink, s.options.quality);
    std::optional<RotatedSink> turning;
    if (header.direction != kAlongWorld) {
        turning.emplace(measuring, header.origin, header.direction);
    }
    MeshSink& to = turning ? static_cast<MeshSink&>(*turning) : measuring;
    const NetMesh mesh = s.query.stages.components
                             ? emit_kept(s, net, label, scratch, to, report, progress)
                             : emit_net_mesh(net, label, s.layout, to, progress);
    report.scratch_bytes = scratch.meter()->peak();
    report.vertices = mesh.vertices;
    report.triangles = mesh.triangles;
    report.mending.zero_area = mesh.no_area;
    measuring.report(report);
    const Double3& d = header.spacing;
    // What was moved was itself rounded to float32.
    constexpr double kRoundedUp = 1 + 1e-6;
    report.smooth.emplace();
    report.smooth->passes = s.query.smooth->passes;
    if (mesh.triangles > 0) {
        report.smooth->bound = kRoundedUp * mesh.moved + s.rounding * std::hypot(d[0], d[1], d[2]);
    }
    for (const SharedArea& shared : net.shared(label)) {
        report.smooth->neighbours.push_back({shared.other, shared.area});
    }
    return report;
}

/// For how many threads there is memory to look for a label, a chunk each. Throws Error{limit} if
/// for none.
int threads_to_look(const StoreReader& store, const ExtractOptions& options) {
    const std::size_t chunk = store.layout().array(0, Field::values).chunk_bytes();
    const std::uint64_t each = chunk + decode_heap(chunk);
    require_memory(store.path().string(), options.memory, kLibraryHeap + each,
                   "smoothing its labels");
    return static_cast<int>(
        std::min((options.memory - kLibraryHeap) / each,
                 static_cast<std::uint64_t>(Workers::count_of(options.threads))));
}

/// All meshes of labels, which are ascending. `place`: of each in the caller's list.
void smooth_sorted(const StoreReader& store, std::span<const Label> labels,
                   std::span<const std::size_t> place, const LabelQuery& query,
                   const std::function<std::shared_ptr<MeshSink>(std::size_t)>& sink,
                   const std::function<void(std::size_t, const ExtractReport&)>& done,
                   const ExtractOptions& options, Progress& progress) {
    const auto start = SmoothClock::now();
    const StoreHeader& header = store.layout().header();
    std::vector<std::int64_t> wanted;
    Int3 lo = header.nodes;
    Int3 hi{};
    for (const Label& label : labels) {
        wanted.push_back(label.id);
        const auto [from, to] = cells_of_label(label);
        lo = min(lo, from);
        hi = max(hi, to);
    }
    const NetSetting setting{header.nodes,
                             header.spacing,
                             header.origin,
                             query.smooth->passes,
                             query.stages.close.has_value(),
                             wanted};
    // The list above, and the caller's copy.
    const std::uint64_t lists =
        labels.size() * (sizeof(std::int64_t) + sizeof(Label) + sizeof(std::size_t));
    const std::uint64_t memory = options.memory - std::min(options.memory, lists);
    const NetPlan plan = net_plan(setting, store.layout().array(0, Field::values), lo, hi, memory,
                                  options.threads, store.path().string());
    const ScratchFolder scratch = ScratchFolder::metered(options.scratch);
    NetStore net(scratch, ceil_div(setting.cells(), kPieceCells));
    const NetCounts counts = make_net(store, setting, plan, labels, net, progress);
    SmoothSetting s{store, query, options, {}, rounding_of(header)};
    s.layout.unit = header.unit;
    const ExtractReport begun = begun_report(s, counts);
    const auto threads = static_cast<int>(
        std::clamp<std::uint64_t>((memory - kLibraryHeap) / kNetMeshHeap, 1,
                                  static_cast<std::uint64_t>(Workers::count_of(options.threads))));
    progress.begin("write mesh", labels.size(), "labels");
    Workers(threads).execute([&] {
        tbb::parallel_for(
            tbb::blocked_range<std::size_t>(0, labels.size(), 1),
            [&](const tbb::blocked_range<std::size_t>& range) {
                for (std::size_t i = range.begin(); i < range.end(); ++i) {
                    progress.check();
                    const std::shared_ptr<MeshSink> to = sink(place[i]);
                    const std::filesystem::path& input = store.path();
                    to->prepare(s.layout, std::span(&input, 1));
                    ExtractReport report =
                        emit_label(s, net, labels[i].id, scratch, *to, begun, progress);
                    report.seconds =
                        std::chrono::duration<double>(SmoothClock::now() - start).count();
                    done(place[i], report);
                    progress.advance(1);
                }
            },
            tbb::simple_partitioner{});
    });
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
    std::vector<std::size_t> place(labels.size());
    std::iota(place.begin(), place.end(), std::size_t{0});
    std::sort(place.begin(), place.end(),
              [&](std::size_t a, std::size_t b) { return labels[a].id < labels[b].id; });
    std::vector<Label> sorted;
    std::transform(place.begin(), place.end(), std::back_inserter(sorted),
                   [&](std::size_t i) { return labels[i]; });
    smooth_sorted(
        store, sorted, place, query, [&](std::size_t i) { return sink(labels[i]); }, done, options,
        progress);
}

ExtractReport smooth_label(const StoreReader& store, const LabelQuery& query, MeshSink& sink,
                           const ExtractOptions& options, Progress& progress) {
    require_smoothable(store, query);
    require_label(store, query.label.id);
    std::optional<Label> label;
    if (const auto& within = query.label.within) {
        label = Label{query.label.id, 0, within->first, within->second};
    } else {
        label = find_label(store, query.label.id,
                           value_of_label(store.layout().header(), query.label.id),
                           threads_to_look(store, options), progress);
    }
    ExtractReport report;
    const std::size_t place = 0;
    // Of a label that is not there the net is one of no cells, and the mesh is empty.
    const Label none{query.label.id, 0, {}, {}};
    smooth_sorted(
        store, std::span(label ? &*label : &none, 1), std::span(&place, 1), query,
        // The caller's, which stays.
        [&](std::size_t) { return std::shared_ptr<MeshSink>(std::shared_ptr<void>(), &sink); },
        [&](std::size_t, const ExtractReport& r) { report = r; }, options, progress);
    return report;
}

}  // namespace isonest::detail
