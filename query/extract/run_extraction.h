// An extraction from its query on.
#pragma once

#include <functional>
#include <memory>
#include <span>

#include "query/extract/extract_query.h"

namespace isonest::detail {

/// As the public extract(). REQUIRES: `asked` was made for this store and this sink.
ExtractReport run_extraction(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                             const ExtractOptions& options, Progress& progress);

/// Several isovalues of one query, by as few traversals as the memory allows. `sink(i)` makes the
/// sink of isovalue number i; `done(i, report)` is called when its mesh is whole, in order.
/// REQUIRES: `asked` is a surface or isolines of values, was made for sinks like these, and has no
/// analysis. Throws as run_extraction(), and what the functions throw.
void run_extractions(const StoreReader& store, const ExtractQuery& asked,
                     std::span<const double> isovalues,
                     const std::function<std::unique_ptr<MeshSink>(std::size_t)>& sink,
                     const std::function<void(std::size_t, const ExtractReport&)>& done,
                     const ExtractOptions& options, Progress& progress);

}  // namespace isonest::detail
