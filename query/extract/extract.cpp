#include <isonest/extract.h>

#include "query/extract/combinations.h"
#include "query/extract/error_budget.h"
#include "query/extract/labels/smooth_labels.h"
#include "query/extract/own_axes.h"
#include "query/extract/run_extraction.h"
#include "query/extract/volume_interval.h"
#include "query/mesh/rotated_sink.h"

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
    detail::RotatedSink turning(sink, header.origin, header.direction);
    ExtractReport report =
        run_along_axes(store, detail::in_own_axes(query, header, store.reader().path().string()),
                       turning, options, progress);
    detail::report_turning(turning, header.spacing, report);
    return report;
}
ExtractReport run(const Store& store, const SurfaceQuery& query, MeshSink& sink,
                  const ExtractOptions& options, Progress& progress) {
    // The search makes extractions of its own, each of which turns what is asked for and its mesh.
    if (std::holds_alternative<ErrorBudget>(query.stop)) {
        return detail::extract_within_error_budget(store, query, sink, options, progress);
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
    detail::require_combination(detail::wishes_of(reader, query), reader.path().string());
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
