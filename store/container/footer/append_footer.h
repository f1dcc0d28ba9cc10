// Writes what follows HDF5's part of a store.
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

namespace isonest::detail {

/// Appends catalogue and footer to `file`, which HDF5 has closed and ends where HDF5's part does.
/// `shown`: the store's name, for messages. Throws Error{io}.
void append_footer(const std::filesystem::path& file, const std::vector<std::byte>& catalogue,
                   const std::filesystem::path& shown);

}  // namespace isonest::detail
