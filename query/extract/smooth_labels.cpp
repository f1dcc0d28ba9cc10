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
#include "query/extract/label_sheets.h"
#include "query/extract/query_checks.h"
#include "query/labels/find_label.h"
#include "query/mesh/coordinate_rounding.h"
#include "query/mesh/measuring_sink.h"
#include "query/mesh/rotated_sink.h"
#include "query/surface_nets/make_net.h"
#include "query/surface_nets/net_interfaces.h"
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

/// `interfaces`: whether those are asked for, and not meshes of labels.
void require_smoothable(const StoreReader& store, const LabelQuery& query,
                        bool interfaces = false) {
    const std::string name = store.path().string();
    Wishes wishes = wishes_of(store, query);
    if (interfaces) {
        wishes.set(static_cast<std::size_t>(Wish::interfaces));
    }
    require_combination(wishes, name);
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

ExtractReport begun_report(const SmoothSetting& s, const NetCounts& counts,
                           const ScratchMeter& scratch) {
    ExtractReport report;
    report.value_range = std::max(s.store.max_value() - s.store.min_value(), 0.0);
    report.coordinate_rounding = s.rounding;
    report.traversal.cells = Cells::hexahedra;
    report.traversal.bricks = counts.blocks;
    report.traversal.chunks_read = counts.chunks_read;
    report.traversal.chunks_total = s.store.layout().rows();
    report.traversal.bytes_read = counts.bytes_read;
    report.traversal.peak_cache_bytes = counts.peak_cache_bytes;
    report.scratch_bytes = scratch.peak();
    if (s.query.stages.close) {
        report.closing = ClosingReport{*s.query.stages.close};
    }
    return report;
}

/// A mesh on its way to its sink: `emit` hands it over.
ExtractReport emit_measured(const SmoothSetting& s, MeshSink& sink, ExtractReport report,
                            const std::function<NetMesh(MeshSink&)>& emit) {
    const StoreHeader& header = s.store.layout().header();
    MeasuringSink measuring(sink, s.options.quality);
    std::optional<RotatedSink> turning;
    if (header.direction != kAlongWorld) {
        turning.emplace(measuring, header.origin, header.direction);
    }
    const NetMesh mesh = emit(turning ? static_cast<MeshSink&>(*turning) : measuring);
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
        report.smooth->bound = kRoundedUp * mesh.moved + s.rounding * std::hypot(d[0], d[1], d[2]) +
                               (report.distance ? report.distance->bound : 0);
        if (report.distance && !s.query.smooth->keep_nodes) {
            report.smooth->nodes_beyond = report.distance->bound;
        }
    }
    return report;
}

bool simplifies(const LabelQuery& query) {
    const DistanceBound* const bound =
        query.stop ? std::get_if<DistanceBound>(&*query.stop) : nullptr;
    return query.stop && (bound == nullptr || bound->value != 0);
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

/// A number that no label of the store has.
std::int64_t outside_of(const StoreReader& store) {
    const double least = store.min_value();
    if (store.layout().header().labels || !(least < 0)) {
        return -1;
    }
    return static_cast<std::int64_t>(std::floor(least)) - 1;
}

/// The net of labels, which are ascending, and what is the same for all meshes out of it.
class MadeNet {
  public:
    /// `interfaces`: whether those are asked for, and not meshes of labels alone.
    MadeNet(const StoreReader& store, std::span<const Label> labels, const LabelQuery& query,
            const ExtractOptions& options, bool interfaces, Progress& progress)
        : setting{store, query, options, {}, rounding_of(store.layout().header())},
          outside(outside_of(store)),
          scratch_(ScratchFolder::metered(options.scratch)) {
        const StoreHeader& header = store.layout().header();
        const bool sides = interfaces || simplifies(query);
        Int3 lo = header.nodes;
        Int3 hi{};
        for (const Label& label : labels) {
            wanted.push_back(label.id);
            const auto [from, to] = cells_of_label(label);
            lo = min(lo, from);
            hi = max(hi, to);
        }
        if (labels.empty()) {
            lo = {0, 0, 0};
            hi = {1, 1, 1};
        }
        const NetSetting net_setting{header.nodes,
                                     header.spacing,
                                     header.origin,
                                     query.smooth->passes,
                                     query.stages.close.has_value(),
                                     wanted,
                                     sides};
        // The list above, and the caller's copy.
        const std::uint64_t lists =
            labels.size() * (sizeof(std::int64_t) + sizeof(Label) + sizeof(std::size_t));
        const std::uint64_t memory = options.memory - std::min(options.memory, lists);
        const NetPlan plan = net_plan(net_setting, store.layout().array(0, Field::values), lo, hi,
                                      memory, options.threads, store.path().string());
        net.emplace(scratch_, ceil_div(net_setting.cells(), kPieceCells), sides);
        const NetCounts counts = make_net(store, net_setting, plan, labels, *net, progress);
        setting.layout.unit = header.unit;
        begun = begun_report(setting, counts, *scratch_.meter());
        if (simplifies(query)) {
            const Double3& d = header.spacing;
            sheets.emplace(*net,
                           SheetSetting{header, query, options, wanted, outside,
                                        setting.rounding * std::hypot(d[0], d[1], d[2]),
                                        store.path().string()},
                           scratch_, progress);
            begun.distance = sheets->distance();
            begun.within_budget = sheets->within_budget();
            begun.scratch_bytes = scratch_.meter()->peak();
        }
        threads = static_cast<int>(std::clamp<std::uint64_t>(
            (memory - kLibraryHeap) / kNetMeshHeap, 1,
            static_cast<std::uint64_t>(Workers::count_of(options.threads))));
    }

    /// The mesh of wanted[number], to its sink.
    ExtractReport emit_label(std::size_t number, MeshSink& sink, const Progress& progress) const {
        const std::int64_t label = wanted[number];
        ExtractReport report = emit_measured(setting, sink, begun, [&](MeshSink& to) {
            return sheets ? sheets->emit_label(number, setting.layout, to, progress)
                          : emit_net_mesh(*net, label, setting.layout, to, progress);
        });
        if (!sheets) {
            for (const SharedArea& shared : net->shared(label)) {
                report.smooth->neighbours.push_back({shared.other, shared.area});
            }
            return report;
        }
        for (const auto& [other, area] : sheets->areas(number)) {
            if (other != outside) {
                report.smooth->neighbours.push_back({other, area});
            }
        }
        CallbackSink nowhere({}, {});
        MeasuringSink full(nowhere, false);
        report.distance->full_triangles =
            emit_net_mesh(*net, label, setting.layout, full, progress).triangles;
        ExtractReport measured;
        full.report(measured);
        report.distance->full = measured.measures;
        return report;
    }
    /// All interfaces, to a sink.
    ExtractReport emit_interfaces(MeshSink& sink, const Progress& progress) const {
        return emit_measured(setting, sink, begun, [&](MeshSink& to) {
            return sheets ? sheets->emit_all(setting.layout, to, progress)
                          : emit_net_interfaces(*net, outside, setting.layout, to, progress);
        });
    }
    /// Calls `each` with every interface that is left.
    void each_interface_of(const std::function<void(const SharedArea&)>& each) const {
        if (!sheets) {
            each_interface(*net, wanted, each);
            return;
        }
        for (std::size_t i = 0; i < wanted.size(); ++i) {
            for (const auto& [other, area] : sheets->areas(i)) {
                const bool came = other != outside && other < wanted[i] &&
                                  std::binary_search(wanted.begin(), wanted.end(), other);
                if (!came) {
                    const bool is_second = other != outside && other < wanted[i];
                    each({is_second ? other : wanted[i],
                          is_second          ? wanted[i]
                          : other == outside ? kOutsideLabel
                                             : other,
                          area});
                }
            }
        }
    }

    SmoothSetting setting;
    std::vector<std::int64_t> wanted;  ///< the labels
    std::int64_t outside;              ///< what meshes call what is no label
    std::optional<NetStore> net;
    std::optional<LabelSheets> sheets;  ///< if they are simplified
    ExtractReport begun;
    int threads = 1;  ///< for as many meshes at a time there is memory

  private:
    ScratchFolder scratch_;
};

double seconds_since(SmoothClock::time_point start) {
    return std::chrono::duration<double>(SmoothClock::now() - start).count();
}

/// All meshes of labels, which are ascending. `place`: of each in the caller's list.
void smooth_sorted(const StoreReader& store, std::span<const Label> labels,
                   std::span<const std::size_t> place, const LabelQuery& query,
                   const std::function<std::shared_ptr<MeshSink>(std::size_t)>& sink,
                   const std::function<void(std::size_t, const ExtractReport&)>& done,
                   const ExtractOptions& options, Progress& progress) {
    const auto start = SmoothClock::now();
    const MadeNet made(store, labels, query, options, false, progress);
    progress.begin("write mesh", labels.size(), "labels");
    Workers(made.threads).execute([&] {
        tbb::parallel_for(
            tbb::blocked_range<std::size_t>(0, labels.size(), 1),
            [&](const tbb::blocked_range<std::size_t>& range) {
                for (std::size_t i = range.begin(); i < range.end(); ++i) {
                    progress.check();
                    const std::shared_ptr<MeshSink> to = sink(place[i]);
                    const std::filesystem::path& input = store.path();
                    to->prepare(made.setting.layout, std::span(&input, 1));
                    ExtractReport report = made.emit_label(i, *to, progress);
                    report.seconds = seconds_since(start);
                    done(place[i], report);
                    progress.advance(1);
                }
            },
            tbb::simple_partitioner{});
    });
}

/// Where the labels stand in their list, by their ids.
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
    smooth_sorted(
        store, in_places(labels, place), place, query,
        [&](std::size_t i) { return sink(labels[i]); }, done, options, progress);
}

ExtractReport label_interfaces(const StoreReader& store, std::span<const Label> labels,
                               const LabelQuery& query, MeshSink& sink,
                               const std::function<void(const LabelInterface&)>& each,
                               const ExtractOptions& options, Progress& progress) {
    const auto start = SmoothClock::now();
    require_smoothable(store, query, true);
    MeshLayout layout;
    layout.has_sides = true;
    layout.unit = store.layout().header().unit;
    const std::filesystem::path& input = store.path();
    sink.prepare(layout, std::span(&input, 1));
    const std::vector<Label> sorted = in_places(labels, places_by_id(labels));
    const MadeNet made(store, sorted, query, options, true, progress);
    progress.begin("write mesh", 1, "meshes");
    InterfaceReport interfaces;
    interfaces.outside = made.outside;
    ExtractReport report;
    Workers(made.threads).execute([&] { report = made.emit_interfaces(sink, progress); });
    made.each_interface_of([&](const SharedArea& shared) {
        ++interfaces.interfaces;
        if (each) {
            each({shared.label, has_mesh(shared.other) ? shared.other : interfaces.outside,
                  shared.area});
        }
    });
    report.measures->volume.reset();  // more than one solid has triangles of it
    report.interfaces = interfaces;
    progress.advance(1);
    report.seconds = seconds_since(start);
    return report;
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
