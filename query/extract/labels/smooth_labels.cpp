#include "query/extract/labels/smooth_labels.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <iterator>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "query/extract/combinations.h"
#include "query/extract/labels/label_details.h"
#include "query/extract/labels/label_net.h"
#include "query/extract/query_checks.h"
#include "query/labels/find_label.h"
#include "query/surface_nets/net_interfaces.h"
#include "query/view/label_view.h"
#include "store/base/memory_budget.h"
#include "store/base/workers.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

using SmoothClock = std::chrono::steady_clock;

/// `wish`: what else is asked for than meshes of labels.
void require_smoothable(const StoreReader& store, const LabelQuery& query,
                        std::optional<Wish> wish = {}) {
    const std::string name = store.path().string();
    Wishes wishes = wishes_of(store, query);
    if (wish) {
        wishes.set(static_cast<std::size_t>(*wish));
    }
    require_combination(wishes, name);
    if (query.stop) {
        std::visit([](const auto& stop) { require_distance(stop); }, *query.stop);
    }
    if (query.stages.components) {
        require_components(*query.stages.components);
    }
    if (query.smooth->passes < 0 || query.smooth->passes > LabelSmoothing::kMostPasses) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("smooth {}: give a number of passes from 0 to {}",
                                query.smooth->passes, LabelSmoothing::kMostPasses));
    }
    const double rounding = net_rounding(store.layout().header());
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

double seconds_since(SmoothClock::time_point start) {
    return std::chrono::duration<double>(SmoothClock::now() - start).count();
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

/// All meshes of labels, which are ascending. `place`: of each in the caller's list.
void smooth_sorted(const StoreReader& store, std::span<const Label> labels,
                   std::span<const std::size_t> place, const LabelQuery& query,
                   const std::function<std::shared_ptr<MeshSink>(std::size_t)>& sink,
                   const std::function<void(std::size_t, const ExtractReport&)>& done,
                   const ExtractOptions& options, Progress& progress) {
    const auto start = SmoothClock::now();
    const LabelNet net(store, labels, query, options, {}, progress);
    each_label(net, labels.size(), progress, [&](std::size_t i) {
        const std::shared_ptr<MeshSink> to = sink(place[i]);
        const std::filesystem::path& input = store.path();
        to->prepare(net.layout(), std::span(&input, 1));
        ExtractReport report = net.emit_label(i, *to, progress);
        report.seconds = seconds_since(start);
        done(place[i], report);
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

void neuroglancer_labels(
    const StoreReader& store, std::span<const Label> labels, const LabelQuery& query,
    const std::filesystem::path& folder,
    const std::function<void(std::size_t number, const NeuroglancerReport&)>& done,
    const ExtractOptions& options, Progress& progress) {
    const auto start = SmoothClock::now();
    require_smoothable(store, query, Wish::details);
    const StoreHeader& header = store.layout().header();
    const std::vector<std::size_t> place = places_by_id(labels);
    const std::vector<Label> sorted = in_places(labels, place);
    const LabelNet net(store, sorted, query, options, {.details = detail_setting(header)},
                       progress);
    each_label(net, sorted.size(), progress, [&](std::size_t i) {
        NeuroglancerReport report =
            write_label_details(net, header, i, sorted[i], folder, progress);
        report.finest.scratch_bytes = net.scratch().meter()->peak();
        report.finest.seconds = seconds_since(start);
        done(place[i], report);
    });
}

ExtractReport label_interfaces(const StoreReader& store, std::span<const Label> labels,
                               const LabelQuery& query, MeshSink& sink,
                               const std::function<void(const LabelInterface&)>& each,
                               const ExtractOptions& options, Progress& progress) {
    const auto start = SmoothClock::now();
    require_smoothable(store, query, Wish::interfaces);
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
    ExtractReport report;
    Workers(net.threads()).execute([&] { report = net.emit_interfaces(sink, progress); });
    net.each_interface_of([&](const SharedArea& shared) {
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
