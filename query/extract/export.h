// Exports fields of a store to plain volume files.
#pragma once

#include <filesystem>

#include <isonest/export_field.h>
#include <isonest/progress.h>

#include "store/container/reader.h"

namespace isonest::detail {

/// See <isonest/export_field.h>.
Int3 export_field(const StoreReader& store, const std::filesystem::path& path,
                  const ExportOptions& options, Progress& progress);

}  // namespace isonest::detail
