// Exports fields of a store to plain volume files.
#pragma once

#include <filesystem>

#include <isonest/field.h>
#include <isonest/progress.h>

#include "store/container/reader.h"

namespace isonest::detail {

struct ExportOptions {
    Field field = Field::values;
    /// For values: the level. For indicators: only nodes of this level or coarser, 0 or 1 = all.
    int level = 0;
    bool force = false;
    std::uint64_t memory = std::uint64_t{256} << 20U;
};

/// Values: writes the lattice of a level in the input's type. 64-bit labels are written as int64;
/// such a store has no indicators to export (Error{unsupported}). An indicator: writes the nodal
/// array on the finest lattice as float32, 0 at the macro vertices (and at nodes that refine
/// nothing in the volume). The file type is given by the name: see create_volume_file(). Fields of
/// cells are rejected. Each chunk is decoded a bounded number of times, values once. Throws
/// Error{not_found, invalid_argument, limit, io, corrupt, cancelled}.
void export_field(const StoreReader& store, const std::filesystem::path& path,
                  const ExportOptions& options, Progress& progress);

}  // namespace isonest::detail
