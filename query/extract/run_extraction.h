// An extraction from its query on.
#pragma once

#include "query/extract/extract_query.h"

namespace isonest::detail {

/// As the public extract(). REQUIRES: `asked` was made for this store and this sink.
ExtractReport run_extraction(const StoreReader& store, ExtractQuery asked, MeshSink& sink,
                             const ExtractOptions& options, Progress& progress);

}  // namespace isonest::detail
