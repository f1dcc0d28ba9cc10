// Binary PLY, written in parallel from the parts of a mesh.
#pragma once

#include <filesystem>

#include "query/weld.h"
#include "store/progress.h"

namespace isonest {

/// Writes `path` whole: x, y, z as float32 and triangles as lists of int32 (uint32 beyond 2^31 - 1
/// vertices). Throws Error{limit} beyond 2^32 - 1 vertices, the end of PLY's index types, and
/// Error{io, cancelled, invalid_argument}.
void write_ply(const std::filesystem::path& path, bool force, const PartStore& parts,
               const Weld& weld, Progress& progress);

}  // namespace isonest
