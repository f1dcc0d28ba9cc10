// What of a store elsewhere is fetched before the page asks for anything.
#pragma once

#include <cstdint>
#include <optional>

#include "store/container/reader.h"

namespace isonest::detail::view {

/// The coarsest levels of a store: the values, and the field by which an error is bounded.
struct FirstLevels {
    /// Of values and bound together, more than which are not taken: at 50 Mbit/s a sixth of a
    /// second.
    static constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 20U;

    int level = 0;  ///< the finest of them
    /// Surfaces and slices within this error need these levels alone, but for the normals of
    /// vertices that lie in nodes.
    double error = 0;
};

/// Announces them, in one go, and returns at once where the rows of their chunks came with the
/// opening, as those of coarse levels do. Nothing of a file, of labels, and where the store has no
/// catalogue or no bound. Throws Error{corrupt, io}.
std::optional<FirstLevels> fetch_first_levels(const StoreReader& store);

}  // namespace isonest::detail::view
