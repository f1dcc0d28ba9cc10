// The attributes that say what a store is: see FORMAT.md. Private to the store.
#pragma once

#include <hdf5.h>

#include <cstdint>
#include <string_view>
#include <vector>

#include "store/container/format.h"

namespace isonest::detail {

/// Those of the root group that are known before any chunk. Throws Error{io}.
void write_header(hid_t root, const StoreHeader& header);

/// Those of the group /VTKHDF, by which ParaView places an image. Throws Error{io}.
void write_vtk_attributes(hid_t group, const StoreHeader& header);

/// XXH64 of the nine numbers, as the attribute `direction` has them.
std::uint64_t direction_digest(const Directions& direction);

/// XXH64 of the attribute `unit` as it is stored.
std::uint64_t unit_digest(std::string_view symbol);

/// VTK's matrix, row by row; its columns are the axes.
std::vector<double> vtk_direction(const Directions& direction);

}  // namespace isonest::detail
