// The last bytes of a store, which lead to its catalogue: FORMAT.md, "Footer and catalogue".
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "store/bytes/store_bytes.h"
#include "store/container/footer/catalogue.h"

namespace isonest::detail {

inline constexpr std::size_t kFooterBytes = 64;
/// What is read of a store that is far away before anything is known of it.
inline constexpr std::uint64_t kFarTail = 65536;

struct Footer {
    std::uint64_t catalogue = 0;  ///< where it begins
    std::uint64_t catalogue_bytes = 0;
    std::uint64_t catalogue_xxh64 = 0;
    std::uint64_t hdf5_end = 0;    ///< of HDF5's part of the file, as its superblock has it
    std::uint64_t file_bytes = 0;  ///< with the footer
};

/// What follows HDF5's part of a file, which ends there: zeros up to a multiple of 8, the
/// catalogue, the footer.
std::vector<std::byte> bytes_behind_hdf5(std::uint64_t hdf5_end,
                                         std::span<const std::byte> catalogue);

/// A catalogue in a file.
struct FoundCatalogue {
    Footer footer;
    HeldBytes tail;                ///< the end of the file, which was read for it
    std::uint64_t tail_begin = 0;  ///< in the file
    HeldBytes bytes;               ///< of the catalogue, which `catalogue` looks at
    Catalogue catalogue;
};

/// Where HDF5's part of the file ends, by its superblock; nothing if that is not of the kind that
/// stores have.
std::optional<std::uint64_t> hdf5_end_of(const StoreBytes& bytes);

/// Nothing if the file ends otherwise, or in a footer of another version, or, of a file that is
/// not far, if HDF5's part of it ends elsewhere by now: then HDF5's own structures say what is
/// there. Throws Error{corrupt} if footer or catalogue are damaged, and Error{io}.
std::optional<FoundCatalogue> find_catalogue(const StoreBytes& bytes);

}  // namespace isonest::detail
