#include <isonest/extract.h>

#include "query/extract/error_budget.h"
#include "query/extract/run_extraction.h"

namespace isonest {
namespace {

template <class Query>
ExtractReport run(const Store& store, const Query& query, MeshSink& sink,
                  const ExtractOptions& options, Progress& progress) {
    return detail::run_extraction(
        store.reader(), detail::extract_query(store.reader(), query, sink.holds_float64()), sink,
        options, progress);
}

}  // namespace

ExtractReport extract(const Store& store, const SurfaceQuery& query, MeshSink& sink,
                      const ExtractOptions& options, Progress& progress) {
    if (std::holds_alternative<ErrorBudget>(query.stop)) {
        return detail::extract_within_error_budget(store, query, sink, options, progress);
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
