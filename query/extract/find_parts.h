// What is extracted -> parts: the traversal that a product needs.
#pragma once

#include <functional>
#include <span>

#include "query/extract/extract_query.h"
#include "query/mesh/part_store.h"
#include "query/ranks/rank_team.h"
#include "query/traverse/traversal_budget.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// How the memory of a query's traversal is shared, for so many isovalues at once. Throws
/// Error{limit} if there is too little.
TraversalBudget parts_budget(const StoreReader& store, const ExtractQuery& query,
                             const ExtractOptions& options, std::uint64_t isovalues);

/// Parts of one isovalue, and what is said of them.
struct FoundParts {
    double iso = 0;
    PartStore* parts = nullptr;
    ExtractReport* report = nullptr;
    /// On rank 0 of several, see settle_parts(); none: parts of all ranks go to rank 0.
    std::function<bool()> may_stay = {};
    bool stay = false;  ///< set by find_parts(): each rank has its parts
};

/// The parts are to see which of their vertices may lie in one place, if the query keeps those
/// apart, and which have no normal, if they are to have one.
void watch_vertices(const ExtractQuery& asked, PartStore& parts);

/// Traverses once, fills all parts and seals them; what that takes beside them is free again
/// afterwards. Says in the reports what it did; chunks are counted in each. REQUIRES: only a
/// surface or isolines of values have several isovalues; is called within an arena of
/// budget.threads. `team`: ranks that share the traversal, or null; collective then: rank 0 gets
/// the parts of all unless they stay, and its reports count what all did. Throws what traverse()
/// throws.
void find_parts(const StoreReader& store, const ExtractQuery& asked, const TraversalBudget& budget,
                std::span<FoundParts> found, const ScratchFolder& scratch, Progress& progress,
                RankTeam* team = nullptr);

}  // namespace isonest::detail
