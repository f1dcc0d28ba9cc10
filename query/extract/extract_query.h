// What an extraction's options ask of a store, in lattice terms.
#pragma once

#include <filesystem>

#include "query/extract/extract.h"
#include "query/traverse/traversal.h"

namespace isonest::detail {

struct ExtractQuery {
    TraversalQuery traversal;
    double threshold = 0;  ///< of the stop field, in its own units
    /// Of the mesh: world coordinates are origin + spacing * position.
    Double3 spacing{1, 1, 1};
    Double3 origin{};
    double coordinate_rounding = 0;  ///< as in the report
};

/// Refuses what makes no sense for this store or cannot be written as `mesh`. Throws
/// Error{invalid_argument, not_found, limit} as extract() does.
ExtractQuery extract_query(const StoreReader& store, const std::filesystem::path& mesh,
                           const ExtractOptions& options);

}  // namespace isonest::detail
