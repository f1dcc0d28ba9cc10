// Writes a level's values, or an indicator, to a plain volume file.
#pragma once

#include <cstdint>
#include <filesystem>

#include <isonest/computed_field.h>
#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/progress.h>
#include <isonest/store.h>

namespace isonest {

struct ExportOptions {
    AnyField field = Field::values;
    /// For values: the level. For indicators: only nodes of this level or coarser, 0 or 1 = all.
    int level = 0;
    bool force = false;                                ///< replace an existing file
    std::uint64_t memory = std::uint64_t{256} << 20U;  ///< maximum bytes of heap
};

/// Values: writes the lattice of a level in the input's type, 64-bit labels as int64. An indicator:
/// writes the nodal array on the finest lattice as float32, 0 at the macro vertices (and at nodes
/// that refine nothing in the volume). The file type is given by the name: .h5 or .hdf5 with the
/// dataset "data", .nrrd, .nii, .vti, .npy, .mha or .raw. The file appears under its name when it
/// is complete. Each chunk is decoded a bounded number of times, values once. An indicator that is
/// computed needs about 20 bytes of memory per node.
///
/// Returns the number of nodes written along each axis (x, y, z). Throws Error{not_found} for a
/// level or field that the store lacks, Error{invalid_argument} for a field of cells, an unknown
/// file type or an existing file, Error{unsupported} for an indicator of labels of 64 bits,
/// Error{limit, io, corrupt, cancelled}. Thread-safety: any number of concurrent calls with
/// different files.
Int3 export_field(const Store& store, const std::filesystem::path& path,
                  const ExportOptions& options = {}, Progress& progress = silent_progress());

}  // namespace isonest
