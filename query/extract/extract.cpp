#include "query/extract/extract.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/extract.h>

#include "query/extract/combinations.h"
#include "query/extract/extract_query.h"
#include "query/extract/extract_shared.h"
#include "query/extract/extraction.h"
#include "query/extract/kept_analysis.h"
#include "query/extract/labels/label_net.h"
#include "query/extract/query_checks.h"
#include "query/extract/report.h"
#include "query/statistics/find_labels.h"
#include "query/values/label_view.h"
#include "store/base/memory.h"
#include "store/base/workers.h"
#include "store/container/codec.h"

namespace isonest::detail {

std::vector<ArrayReport> describe_arrays(const StoreReader& store) {
    std::vector<ArrayReport> reports;
    for (const ArrayInfo& array : store.layout().arrays()) {
        ArrayReport report;
        report.level = array.level;
        report.field = array.field;
        report.nodes = array.nodes;
        report.chunk = array.chunk;
        report.alias = array.alias;
        report.chunks = static_cast<std::uint64_t>(array.grid.product());
        report.raw_bytes = static_cast<std::uint64_t>(array.nodes.product() * array.components) *
                           array.codec.element_size;
        const ArrayTotals totals = store.totals(array);
        report.stored_bytes = totals.bytes;
        report.min = totals.min;
        report.max = totals.max;
        if (const StoreHeader& header = store.layout().header(); header.labels) {
            const auto low = wide_label(header, totals.min);
            const auto high = wide_label(header, totals.max);
            if (array.field != Field::values) {
                report.min = report.max = std::numeric_limits<double>::quiet_NaN();
            } else if (low && high) {
                report.labels = {*low, *high};
                report.min = static_cast<double>(*low);
                report.max = static_cast<double>(*high);
            }
        }
        reports.push_back(report);
    }
    return reports;
}

std::uint64_t cube_range_bytes(const StoreReader& store) {
    std::uint64_t bytes = 0;
    for (int level = kFirstRangeLevel; store.layout().has_cube_ranges(level); ++level) {
        bytes += static_cast<std::uint64_t>(store.layout().lattice().cells_at(level).product()) *
                 cube_range_bytes(store.layout().header().type);
    }
    return bytes;
}

// The steps of every extraction:
//
//     query -> parts           query/extract/extraction.h
//     parts -> mesh in a sink  query/extract/extraction.h

namespace {

/// The number of threads for which there is memory to search for a label, a chunk each. Throws
/// Error{limit} if there is none.
int threads_to_look(const StoreLayout& layout, const MemoryShare& memory) {
    const std::size_t chunk = layout.array(0, Field::values).chunk_bytes();
    return memory.threads_of(chunk + decode_heap(chunk), "smoothing its labels");
}

std::vector<double> isovalues_of(std::span<const std::unique_ptr<Extraction>> extractions) {
    std::vector<double> isovalues;
    for (const auto& e : extractions) {
        isovalues.push_back(e->asked().traversal.iso);
    }
    return isovalues;
}

/// Extracts several isovalues with one traversal for all of them.
void run_together(std::span<const std::unique_ptr<Extraction>> extractions,
                  const StoreReader& store, RankTeam* all_ranks, Progress& progress,
                  const std::function<void(std::size_t, const ExtractReport&)>& done) {
    for (const auto& e : extractions) {
        e->prepare({store.path()});
    }
    const ExtractQuery& asked = extractions.front()->asked();
    PartsTraversal traversal(store, asked, extractions.front()->memory(), extractions.size());
    const TraversalBudget& budget = traversal.budget();
    // While the stages process one mesh with all of the memory, the other parts wait.
    const bool has_room = extractions.size() == 1 || !asked.stages.any();
    RankTeam* const team = asked.is_shared() ? all_ranks : nullptr;
    if (team != nullptr) {
        begin_shared_traversal(*team, store, asked, isovalues_of(extractions));
    }
    std::vector<FoundParts> found;
    Workers(budget.threads).execute([&] {
        std::vector<PartsPlace> places;
        for (const auto& e : extractions) {
            places.push_back(e->begin_parts(has_room ? budget.parts / extractions.size() : 0));
        }
        found = traversal.find(places, extractions.front()->scratch(), progress, team);
    });
    for (std::size_t i = 0; i < extractions.size(); ++i) {
        if (found[i].stay) {
            begin_shared_mesh(*team, i);
        }
        done(i, extractions[i]->finish(found[i], budget));
    }
}

}  // namespace

ExtractReport extract_in_own_axes(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                                  const ExtractOptions& options, Progress& progress) {
    ExtractReport report;
    const auto one = std::make_unique<Extraction>(store, std::move(asked), sink, options, progress);
    run_together({&one, 1}, store, options.team, progress,
                 [&](std::size_t, const ExtractReport& r) { report = r; });
    return report;
}

ExtractReport run_extraction(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                             const ExtractOptions& options, Progress& progress) {
    WorldOutput mesh(sink, asked, options, progress);
    std::optional<ExtractReport> report;
    const bool is_analysed = asked.analysis_folder && asked.stages.simplifies();
    if (is_analysed) {
        report = extract_analysed(store, asked, mesh.sink(), options, progress);
    }
    if (!report) {
        report = extract_in_own_axes(store, std::move(asked), mesh.sink(), options, progress);
        if (is_analysed) {
            report->analysis.emplace();
        }
    }
    return mesh.report(std::move(*report));
}

}  // namespace isonest::detail

namespace isonest {
namespace {

void require_isovalues(const std::string& name, std::span<const double> isovalues) {
    if (isovalues.empty()) {
        throw Error(ErrorKind::invalid_argument, {name}, "no isovalues are given");
    }
    if (isovalues.size() > kMaxIsovalues) {
        throw Error(
            ErrorKind::limit, {name},
            fmt::format("{} isovalues; give at most {} per run", isovalues.size(), kMaxIsovalues));
    }
    std::vector<double> sorted(isovalues.begin(), isovalues.end());
    std::sort(sorted.begin(), sorted.end());
    if (const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
        twice != sorted.end()) {
        throw Error(ErrorKind::invalid_argument, {name},
                    fmt::format("the isovalue {} is given twice", *twice));
    }
}

}  // namespace

using detail::extract_query;
using detail::run_extraction;

ExtractReport extract(const Store& store, const SurfaceQuery& query, MeshSink& sink,
                      const ExtractOptions& options, Progress& progress) {
    const detail::StoreReader& reader = store.reader();
    if (query.volume_interval) {
        detail::require_combination(detail::features_of(reader, query), reader.path().string());
        SurfaceQuery alone = query;  // a search for an error extracts it several times
        alone.volume_interval = false;
        ExtractReport report = extract(store, alone, sink, options, progress);
        report.volume_interval =
            detail::volume_interval(store, alone, report.tolerance, options, progress);
        return report;
    }
    // The search runs its own extractions, each of which rotates the query and its mesh.
    if (std::holds_alternative<TriangleBudgetByError>(query.stop)) {
        return detail::extract_within_triangle_budget(store, query, sink, options, progress);
    }
    return run_extraction(reader, extract_query(reader, query, sink.holds_float64()), sink, options,
                          progress);
}
ExtractReport extract(const Store& store, const LabelQuery& query, MeshSink& sink,
                      const ExtractOptions& options, Progress& progress) {
    const detail::StoreReader& reader = store.reader();
    if (!query.smooth) {
        return run_extraction(reader, extract_query(reader, query, sink.holds_float64()), sink,
                              options, progress);
    }
    const detail::SmoothChoice choice = detail::smooth_choice(reader, query);
    const std::int64_t id = query.label.id;
    detail::require_label(reader, id);
    std::optional<Label> label;
    if (const auto& within = query.label.within) {
        label = Label{id, 0, within->first, within->second};
    } else {
        const detail::StoreLayout& layout = reader.layout();
        label = detail::find_label(
            reader, id, detail::value_of_label(layout.header(), id),
            detail::threads_to_look(layout, detail::memory_of(options, reader.path().string())),
            progress);
    }
    // For a label that does not exist, the net has no cells, and the mesh is empty.
    const Label none{id, 0, {}, {}};
    const auto start = std::chrono::steady_clock::now();
    const detail::LabelNet net(reader, std::span(label ? &*label : &none, 1), choice, options, {},
                               progress);
    ExtractReport report;
    detail::each_label(detail::kWriteLabels, net.threads(), 1, progress, [&](std::size_t i) {
        report = detail::timed(net.write_label(i, sink, progress), start);
    });
    return report;
}
ExtractReport extract(const Store& store, const SliceQuery& query, MeshSink& sink,
                      const ExtractOptions& options, Progress& progress) {
    const detail::StoreReader& reader = store.reader();
    return run_extraction(reader, extract_query(reader, query, sink.holds_float64()), sink, options,
                          progress);
}
ExtractReport extract(const Store& store, const ContourQuery& query, MeshSink& sink,
                      const ExtractOptions& options, Progress& progress) {
    const detail::StoreReader& reader = store.reader();
    return run_extraction(reader, extract_query(reader, query, sink.holds_float64()), sink, options,
                          progress);
}
ExtractReport extract(const Store& store, const GraphQuery& query, MeshSink& sink,
                      const ExtractOptions& options, Progress& progress) {
    const detail::StoreReader& reader = store.reader();
    return run_extraction(reader, extract_query(reader, query, sink.holds_float64()), sink, options,
                          progress);
}

void extract_isovalues(const Store& store, std::span<const double> isovalues,
                       const SurfaceQuery& query,
                       const std::function<std::unique_ptr<MeshSink>(std::size_t number)>& sink,
                       const std::function<void(std::size_t number, const ExtractReport&)>& done,
                       const ExtractOptions& options, Progress& progress) {
    const detail::StoreReader& reader = store.reader();
    require_isovalues(reader.path().string(), isovalues);
    SurfaceQuery own = query;
    // One traversal gives all of them, unless each needs a search for an error, a kept analysis or
    // an interval of the volume, or its mesh is rotated.
    if (std::holds_alternative<TriangleBudgetByError>(query.stop) || query.analysis ||
        query.volume_interval || reader.layout().header().direction != kAlongWorld) {
        for (std::size_t i = 0; i < isovalues.size(); ++i) {
            own.iso = isovalues[i];
            const std::unique_ptr<MeshSink> to = sink(i);
            done(i, extract(store, own, *to, options, progress));
        }
        return;
    }
    std::unique_ptr<MeshSink> first_sink = sink(0);
    detail::ExtractQuery asked;
    for (const double iso : isovalues) {
        own.iso = iso;
        asked = detail::extract_query(reader, own, first_sink->holds_float64());
    }
    const std::uint64_t most =
        asked.heap(reader.layout())
            .isovalues_at_once(detail::memory_of(options, reader.path().string()),
                               isovalues.size());
    for (std::size_t first = 0; first < isovalues.size(); first += most) {
        const auto some =
            isovalues.subspan(first, std::min<std::size_t>(most, isovalues.size() - first));
        std::vector<std::unique_ptr<MeshSink>> sinks;
        std::vector<std::unique_ptr<detail::WorldOutput>> meshes;
        std::vector<std::unique_ptr<detail::Extraction>> extractions;
        for (std::size_t i = 0; i < some.size(); ++i) {
            detail::ExtractQuery one = asked;
            one.traversal.iso = some[i];
            sinks.push_back(first + i == 0 ? std::move(first_sink) : sink(first + i));
            meshes.push_back(
                std::make_unique<detail::WorldOutput>(*sinks[i], one, options, progress));
            extractions.push_back(std::make_unique<detail::Extraction>(
                reader, std::move(one), meshes[i]->sink(), options, progress));
        }
        detail::run_together(extractions, reader, options.team, progress,
                             [&](std::size_t i, const ExtractReport& report) {
                                 const ExtractReport whole = meshes[i]->report(report);
                                 sinks[i].reset();
                                 done(first + i, whole);
                             });
    }
}

}  // namespace isonest
