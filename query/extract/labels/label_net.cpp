#include "query/extract/labels/label_net.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "query/labels/label_progress.h"
#include "query/mesh/components.h"
#include "query/mesh/coordinate_rounding.h"
#include "query/mesh/measuring_sink.h"
#include "query/mesh/rotated_sink.h"
#include "query/mesh/scratch_mesh.h"
#include "query/surface_nets/make_net.h"
#include "query/surface_nets/net_interfaces.h"
#include "store/base/hypot3.h"
#include "store/base/memory_budget.h"
#include "store/base/rotation.h"
#include "store/base/workers.h"

namespace isonest::detail {
namespace {

bool simplifies(const LabelQuery& query) {
    const DistanceBound* const bound =
        query.stop ? std::get_if<DistanceBound>(&*query.stop) : nullptr;
    return query.stop && (bound == nullptr || bound->value != 0);
}

/// A number that no label of the store has.
std::int64_t outside_of(const StoreReader& store) {
    const double least = store.min_value();
    if (store.layout().header().labels || !(least < 0)) {
        return -1;
    }
    return static_cast<std::int64_t>(std::floor(least)) - 1;
}

}  // namespace

double net_rounding(const StoreHeader& header) {
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

LabelNet::LabelNet(const StoreReader& store, std::span<const Label> labels, const LabelQuery& query,
                   const ExtractOptions& options, const NetUse& use, Progress& progress)
    : store_(store),
      query_(query),
      options_(options),
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
                             header.spacing,
                             header.origin,
                             query.smooth->passes,
                             query.stages.close.has_value(),
                             wanted_,
                             sides};
    // The list above, and the caller's copy.
    const std::uint64_t lists =
        labels.size() * (sizeof(std::int64_t) + sizeof(Label) + sizeof(std::size_t));
    const std::uint64_t memory = options.memory - std::min(options.memory, lists);
    const std::uint64_t each = kNetMeshHeap + (use.details ? use.details->heap : 0);
    if (use.details) {
        require_memory(store.path().string(), memory, kLibraryHeap + each,
                       "packing the meshes of its labels");
    }
    const NetPlan plan = net_plan(setting, store.layout().array(0, Field::values), lo, hi, memory,
                                  options.threads, store.path().string());
    net_.emplace(scratch_, ceil_div(setting.cells(), kPieceCells), sides);
    begun_ = begun_report(make_net(store, setting, plan, labels, *net_, progress));
    if (is_simplified_ || use.details) {
        const Double3& d = header.spacing;
        sheets_.emplace(*net_,
                        SheetSetting{header, query, options, wanted_, outside_,
                                     rounding_ * hypot3(d[0], d[1], d[2]), store.path().string(),
                                     use.details, is_simplified_},
                        scratch_, progress);
    }
    if (is_simplified_) {
        begun_.distance = sheets_->distance();
        begun_.within_budget = sheets_->within_budget();
    }
    static_assert(SheetOutput::kHeap <= kNetMeshHeap);
    threads_ = static_cast<int>(
        std::clamp<std::uint64_t>((memory - kLibraryHeap) / each, 1,
                                  static_cast<std::uint64_t>(Workers::count_of(options.threads))));
}

ExtractReport LabelNet::begun_report(const NetCounts& counts) const {
    ExtractReport report;
    report.value_range = std::max(store_.max_value() - store_.min_value(), 0.0);
    report.coordinate_rounding = rounding_;
    report.traversal.cells = Cells::hexahedra;
    report.traversal.bricks = counts.blocks;
    report.traversal.chunks_read = counts.chunks_read;
    report.traversal.chunks_total = store_.layout().rows();
    report.traversal.bytes_read = counts.bytes_read;
    report.traversal.peak_cache_bytes = counts.peak_cache_bytes;
    if (query_.stages.close) {
        report.closing = ClosingReport{*query_.stages.close};
    }
    return report;
}

/// A mesh on its way to its sink: `emit` hands it over.
ExtractReport LabelNet::emit_measured(
    MeshSink& sink, Axes axes,
    const std::function<NetMesh(MeshSink&, ExtractReport&)>& emit) const {
    const StoreHeader& header = store_.layout().header();
    ExtractReport report = begun_;
    MeasuringSink measuring(sink, options_.quality);
    std::optional<RotatedSink> turning;
    if (axes == Axes::world && header.direction != kAlongWorld) {
        turning.emplace(measuring, header.origin, header.direction);
    }
    const NetMesh mesh = emit(turning ? static_cast<MeshSink&>(*turning) : measuring, report);
    report.scratch_bytes = scratch_.meter()->peak();
    report.vertices = mesh.vertices;
    report.triangles = mesh.triangles;
    report.mending.zero_area = turning ? turning->zero_area_triangles() : mesh.no_area;
    measuring.report(report);
    const Double3& d = header.spacing;
    // What was moved was itself rounded to float32.
    constexpr double kRoundedUp = 1 + 1e-6;
    report.smooth.emplace();
    report.smooth->passes = query_.smooth->passes;
    if (mesh.triangles > 0) {
        const double distance = report.distance ? report.distance->bound : 0;
        report.smooth->bound =
            kRoundedUp * mesh.moved + rounding_ * hypot3(d[0], d[1], d[2]) + distance;
        report.smooth->nodes_beyond = query_.smooth->keep_nodes ? 0 : distance;
    }
    return report;
}

/// A label's mesh without the components that are not kept, to a sink. The others have the vertices
/// and triangles that they have with all; if all are kept, it is the same mesh.
NetMesh LabelNet::emit_kept(std::int64_t label, MeshSink& sink, ExtractReport& report,
                            const Progress& progress) const {
    LabelProgress silent(progress);
    ScratchMesh whole(scratch_);
    NetMesh mesh = emit_net_mesh(*net_, label, layout_, whole, progress);
    KeptComponents kept(whole, *query_.stages.components, scratch_, silent);
    report.components = ComponentReport{kept.components(), kept.dropped(), kept.dropped_elements(),
                                        kept.largest_dropped()};
    if (kept.dropped() == 0) {
        return emit_net_mesh(*net_, label, layout_, sink, progress);
    }
    const EmittedMesh emitted = emit_elements(whole, kept.corners(), scratch_, sink, silent);
    mesh.vertices = emitted.vertices;
    mesh.triangles = emitted.elements;
    mesh.no_area = emitted.zero_area_triangles;
    return mesh;
}

/// And, of one that was simplified, the whole label's size.
void LabelNet::report_neighbours(std::size_t number, ExtractReport& report,
                                 const Progress& progress) const {
    const std::int64_t label = wanted_[number];
    if (!is_simplified_) {
        for (const SharedArea& shared : net_->shared(label)) {
            report.smooth->neighbours.push_back({shared.other, shared.area});
        }
        return;
    }
    for (const auto& [other, area] : sheets_->areas(number)) {
        if (other != outside_) {
            report.smooth->neighbours.push_back({other, area});
        }
    }
    CallbackSink nowhere({}, {});
    MeasuringSink full(nowhere, false);
    report.distance->full_triangles =
        emit_net_mesh(*net_, label, layout_, full, progress).triangles;
    ExtractReport measured;
    full.report(measured);
    report.distance->full = measured.measures;
}

ExtractReport LabelNet::emit_label(std::size_t number, MeshSink& sink, const Progress& progress,
                                   Axes axes) const {
    ExtractReport report = emit_measured(sink, axes, [&](MeshSink& to, ExtractReport& begun) {
        return is_simplified_ ? sheets_->emit_label(number, 0, layout_, to, progress)
               : query_.stages.components
                   ? emit_kept(wanted_[number], to, begun, progress)
                   : emit_net_mesh(*net_, wanted_[number], layout_, to, progress);
    });
    report_neighbours(number, report, progress);
    return report;
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
    return emit_measured(sink, Axes::world, [&](MeshSink& to, ExtractReport&) {
        return is_simplified_ ? sheets_->emit_all(layout_, to, progress)
                              : emit_net_interfaces(*net_, outside_, layout_, to, progress);
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

}  // namespace isonest::detail
