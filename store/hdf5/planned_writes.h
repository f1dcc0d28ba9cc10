// A file driver for HDF5 that makes all its structures and drops the raw data: what others will
// write, at the places that HDF5 has chosen. Private to the store.
#pragma once

#include <cstdint>

#include "store/hdf5/handles.h"

namespace isonest::detail {

/// Shared by the driver and whoever plans a file.
struct PlannedWrites {
    bool drops_raw = false;  ///< raw data are dropped from now on; else they are written
    std::uint64_t last = 0;  ///< where the raw data begin that were dropped last, in the file
};

/// Files that are created with these properties use the driver. What it writes, and where, is what
/// HDF5's own default driver writes. REQUIRES: `writes` lives as long as the file. Thread-safety:
/// that of HDF5, and `writes` is not touched meanwhile.
void use_planned_writes(const PropertyHandle& access, PlannedWrites& writes);

}  // namespace isonest::detail
