// Builds a store's catalogue from what HDF5 finds in the file. Private to the store.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "store/container/format.h"

namespace isonest::detail {

/// The bytes of the catalogue of a store that is complete except for its footer. `file`: its HDF5
/// identifier; `table`: its chunk table. Nullopt if something is missing, or is not as in a store.
/// For a store of a later version, contains only what this version knows.
std::optional<std::vector<std::byte>> make_catalogue(std::int64_t file, const StoreLayout& layout,
                                                     std::span<const std::byte> table);

// Writes what follows HDF5's part of a store.

/// Appends catalogue and footer to `file`, which HDF5 has closed and which ends where HDF5's part
/// ends. `shown`: the store's name, for messages. Throws Error{io}.
void append_footer(const std::filesystem::path& file, const std::vector<std::byte>& catalogue,
                   const std::filesystem::path& shown);

}  // namespace isonest::detail
