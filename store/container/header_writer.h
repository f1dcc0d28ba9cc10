// The attributes that say what a store is: see FORMAT.md. Private to the store.
#pragma once

#include <hdf5.h>

#include <vector>

#include "store/container/format.h"

namespace isonest::detail {

/// Those of the root group that are known before any chunk. Throws Error{io}.
void write_header(hid_t root, const StoreHeader& header);

/// Those of the group /VTKHDF, by which ParaView places an image. Throws Error{io}.
void write_vtk_attributes(hid_t group, const StoreHeader& header);

/// VTK's matrix, row by row; its columns are the axes.
std::vector<double> vtk_direction(const Directions& direction);

}  // namespace isonest::detail
