// Fields of a store as plain volume files.
#pragma once

#include <filesystem>

#include <isonest/field.h>
#include <isonest/progress.h>

#include "store/container/reader.h"

namespace isonest::detail {

struct ExportOptions {
    Field field = Field::values;
    /// Values: the level. Indicators: only nodes of this level or coarser, 0 or 1 = all.
    int level = 0;
    bool force = false;
    std::uint64_t memory = std::uint64_t{256} << 20U;
};

/// Values: the lattice of a level in the input's type; labels of 64 bits as int64, and such a store
/// has no indicators to export (Error{unsupported}). An indicator: the nodal array on the finest
/// lattice as float32, 0 at the macro vertices (and nodes that refine nothing in the volume).
/// The file's kind follows from its name: see create_volume_file().
/// A field of cells is refused. Each chunk is decoded a bounded number of times, values once.
/// Throws Error{not_found, invalid_argument, limit, io, corrupt, cancelled}.
void export_field(const StoreReader& store, const std::filesystem::path& path,
                  const ExportOptions& options, Progress& progress);

}  // namespace isonest::detail
