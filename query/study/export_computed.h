// Indicators that no store holds, as plain volume files.
#pragma once

#include <filesystem>

#include <isonest/progress.h>

#include "query/study/computed_field.h"
#include "store/container/reader.h"

namespace isonest::detail {

struct ExportComputedOptions {
    ComputedField field;
    int level = 0;  ///< only nodes of this level or coarser, 0 or 1 = all
    bool force = false;
    std::uint64_t memory = std::uint64_t{256} << 20U;
};

/// The nodal array on the finest lattice as float32, 0 at the macro vertices, not saturated if the
/// field is not. The file's kind follows from its name: see create_volume_file(). Throws
/// Error{limit} if the lattice does not fit into the memory (about 20 bytes a node), and
/// Error{invalid_argument, io, corrupt, cancelled}.
void export_computed_field(const StoreReader& store, const std::filesystem::path& path,
                           const ExportComputedOptions& options, Progress& progress);

}  // namespace isonest::detail
