// What is extracted -> parts: the traversal that a product needs.
#pragma once

#include <filesystem>

#include "query/extract/extract_query.h"
#include "query/mesh/part_store.h"
#include "query/traverse/traversal_budget.h"

namespace isonest::detail {

/// How the memory of a query's traversal is shared. Throws Error{limit} if there is too little.
TraversalBudget parts_budget(const StoreReader& store, const ExtractQuery& query,
                             const ExtractOptions& options);

/// Traverses, fills `parts` and seals them; what that takes beside them is free again afterwards.
/// Says in the report what it did. REQUIRES: is called within an arena of budget.threads. Throws
/// what traverse() throws.
void find_parts(const StoreReader& store, const ExtractQuery& asked, const TraversalBudget& budget,
                PartStore& parts, const std::filesystem::path& scratch, ExtractReport& report,
                Progress& progress);

}  // namespace isonest::detail
