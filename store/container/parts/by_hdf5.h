// Finds a store's chunks through HDF5's index of each dataset instead of our chunk table.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "store/bytes/store_bytes.h"
#include "store/container/format.h"

namespace isonest::detail {

/// Thread-safety: one thread at a time, with no concurrent HDF5 calls.
class Hdf5View {
  public:
    /// Throws Error{corrupt} if HDF5 cannot open the file, and what open_hdf5_of() throws.
    explicit Hdf5View(const StoreBytes& bytes);
    Hdf5View(const Hdf5View&) = delete;
    Hdf5View& operator=(const Hdf5View&) = delete;
    ~Hdf5View();

    /// Reads the stored bytes of a chunk with this row. Returns what is wrong, or an empty text.
    /// The chunk may have at most ArrayInfo::max_stored_bytes().
    std::string read(const ArrayInfo& array, const Int3& chunk, const ChunkRow& row,
                     std::vector<std::byte>& out) const;

    /// The catalogue that the store should have: see make_catalogue().
    [[nodiscard]] std::optional<std::vector<std::byte>> catalogue(
        const StoreLayout& layout, std::span<const std::byte> table) const;

    /// What is wrong with the group through which VTK finds the volume; empty if it is correct.
    [[nodiscard]] std::string vtk_fault(const StoreHeader& header) const;

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace isonest::detail
