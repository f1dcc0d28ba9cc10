#include "query/extract/extract.h"

#include <algorithm>
#include <limits>
#include <vector>

#include <isonest/extract.h>

#include "query/extract/combinations.h"
#include "query/extract/extract_query.h"
#include "query/extract/extract_shared.h"
#include "query/extract/extraction.h"
#include "query/extract/kept_analysis.h"
#include "query/extract/labels/label_net.h"
#include "query/extract/query_checks.h"
#include "query/extract/report.h"
#include "query/mesh/measuring_sink.h"
#include "query/mesh/mesh_sinks.h"
#include "query/values/label_view.h"
#include "store/base/workers.h"

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
    const TraversalBudget budget =
        parts_budget(store, asked, extractions.front()->memory(), extractions.size());
    // While the stages process one mesh with all of the memory, the other parts wait.
    const bool has_room = extractions.size() == 1 || !asked.stages.any();
    RankTeam* const team = is_shared(asked) ? all_ranks : nullptr;
    if (team != nullptr) {
        begin_shared_traversal(*team, store, asked, isovalues_of(extractions));
    }
    std::vector<FoundParts> found;
    Workers(budget.threads).execute([&] {
        std::vector<PartsPlace> places;
        for (const auto& e : extractions) {
            places.push_back(e->begin_parts(has_room ? budget.parts / extractions.size() : 0));
        }
        found = find_parts(store, asked, budget, places, extractions.front()->scratch(), progress,
                           team);
    });
    for (std::size_t i = 0; i < extractions.size(); ++i) {
        if (found[i].stay) {
            begin_shared_mesh(*team, i);
        }
        done(i, extractions[i]->finish(found[i], budget));
    }
}

/// From a kept analysis, if requested and fine enough; otherwise from the store.
ExtractReport extracted(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                        const ExtractOptions& options, Progress& progress) {
    const bool is_analysed = asked.analysis_folder && asked.stages.simplifies();
    if (is_analysed) {
        if (std::optional<ExtractReport> report =
                extract_analysed(store, asked, sink, options, progress)) {
            return *report;
        }
    }
    ExtractReport report;
    const auto one = std::make_unique<Extraction>(store, std::move(asked), sink, options, progress);
    run_together({&one, 1}, store, options.team, progress,
                 [&](std::size_t, const ExtractReport& r) { report = r; });
    if (is_analysed) {
        report.analysis.emplace();
    }
    return report;
}

}  // namespace

ExtractReport run_extraction(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                             const ExtractOptions& options, Progress& progress) {
    if (asked.corners() != 3) {
        return extracted(store, std::move(asked), sink, options, progress);
    }
    MeasuringSink measuring(sink, options.quality);
    return measured(extracted(store, std::move(asked), measuring, options, progress), measuring);
}

void run_extractions(const StoreReader& store, const ExtractQuery& asked,
                     std::span<const double> isovalues,
                     const std::function<std::unique_ptr<MeshSink>(std::size_t)>& sink,
                     const std::function<void(std::size_t, const ExtractReport&)>& done,
                     const ExtractOptions& options, Progress& progress) {
    const std::uint64_t most =
        isovalues_at_once(store, asked.traversal, asked.values,
                          memory_of(options, store.path().string()), isovalues.size());
    for (std::size_t first = 0; first < isovalues.size(); first += most) {
        const auto some =
            isovalues.subspan(first, std::min<std::size_t>(most, isovalues.size() - first));
        std::vector<std::unique_ptr<MeshSink>> sinks;
        std::vector<std::unique_ptr<MeasuringSink>> measuring(some.size());
        std::vector<std::unique_ptr<Extraction>> extractions;
        for (std::size_t i = 0; i < some.size(); ++i) {
            ExtractQuery own = asked;
            own.traversal.iso = some[i];
            sinks.push_back(sink(first + i));
            if (asked.corners() == 3) {
                measuring[i] = std::make_unique<MeasuringSink>(*sinks[i], options.quality);
            }
            extractions.push_back(std::make_unique<Extraction>(
                store, std::move(own), measuring[i] ? *measuring[i] : *sinks[i], options,
                progress));
        }
        run_together(extractions, store, options.team, progress,
                     [&](std::size_t i, const ExtractReport& report) {
                         const MeasuringSink* const measures = measuring[i].get();
                         const ExtractReport whole =
                             measures != nullptr ? measured(report, *measures) : report;
                         sinks[i].reset();
                         done(first + i, whole);
                     });
    }
}

}  // namespace isonest::detail

namespace isonest {
namespace {

template <class Query>
ExtractReport run_along_axes(const Store& store, const Query& query, MeshSink& sink,
                             const ExtractOptions& options, Progress& progress) {
    return detail::run_extraction(
        store.reader(), detail::extract_query(store.reader(), query, sink.holds_float64()), sink,
        options, progress);
}

template <class Query>
ExtractReport run(const Store& store, const Query& query, MeshSink& sink,
                  const ExtractOptions& options, Progress& progress) {
    const detail::StoreHeader& header = store.reader().layout().header();
    if (header.direction == kAlongWorld) {
        return run_along_axes(store, query, sink, options, progress);
    }
    const Query own = detail::in_own_axes(query, header, store.reader().path().string());
    const Directions rotation = header.rotation();
    if (rotation == kAlongWorld) {
        return run_along_axes(store, own, sink, options, progress);
    }
    detail::RotatedSink turning(sink, header.origin, rotation);
    const ExtractReport report = run_along_axes(store, own, turning, options, progress);
    return detail::turned(report, turning, header.steps());
}
ExtractReport run(const Store& store, const SurfaceQuery& query, MeshSink& sink,
                  const ExtractOptions& options, Progress& progress) {
    // The search runs its own extractions, each of which rotates the query and its mesh.
    if (std::holds_alternative<TriangleBudgetByError>(query.stop)) {
        return detail::extract_within_triangle_budget(store, query, sink, options, progress);
    }
    return run<SurfaceQuery>(store, query, sink, options, progress);
}

}  // namespace

ExtractReport extract(const Store& store, const SurfaceQuery& query, MeshSink& sink,
                      const ExtractOptions& options, Progress& progress) {
    if (!query.volume_interval) {
        return run(store, query, sink, options, progress);
    }
    const detail::StoreReader& reader = store.reader();
    detail::require_combination(detail::features_of(reader, query), reader.path().string());
    SurfaceQuery alone = query;  // a search for an error extracts it several times
    alone.volume_interval = false;
    ExtractReport report = run(store, alone, sink, options, progress);
    report.volume_interval =
        detail::volume_interval(store, alone, report.tolerance, options, progress);
    return report;
}
ExtractReport extract(const Store& store, const LabelQuery& query, MeshSink& sink,
                      const ExtractOptions& options, Progress& progress) {
    if (query.smooth) {
        return detail::smooth_label(store.reader(), query, sink, options, progress);
    }
    return run(store, query, sink, options, progress);
}
ExtractReport extract(const Store& store, const SliceQuery& query, MeshSink& sink,
                      const ExtractOptions& options, Progress& progress) {
    return run(store, query, sink, options, progress);
}
ExtractReport extract(const Store& store, const ContourQuery& query, MeshSink& sink,
                      const ExtractOptions& options, Progress& progress) {
    return run(store, query, sink, options, progress);
}
ExtractReport extract(const Store& store, const GraphQuery& query, MeshSink& sink,
                      const ExtractOptions& options, Progress& progress) {
    return run(store, query, sink, options, progress);
}

}  // namespace isonest
