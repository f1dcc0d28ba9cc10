// A store's catalogue from what HDF5 finds in the file. Private to the store.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "store/container/format.h"

namespace isonest::detail {

/// The bytes of the catalogue of a store that is complete but for its footer. `file`: HDF5's
/// identifier of it; `table`: its chunk table. Nothing if something is not there, or is of another
/// kind than a store's. For a store of a later version, what this version knows.
std::optional<std::vector<std::byte>> make_catalogue(std::int64_t file, const StoreLayout& layout,
                                                     std::span<const std::byte> table);

}  // namespace isonest::detail
