// Whether a mesh of triangles is closed: how many of its vertices lie on borders.
#pragma once

#include <cstdint>
#include <span>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/mesh/weld.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// A bijection that leaves no pattern (the end of splitmix64).
inline std::uint64_t mixed(std::uint64_t v) {
    v += 0x9E3779B97F4A7C15ULL;
    v = (v ^ (v >> 30U)) * 0xBF58476D1CE4E5B9ULL;
    v = (v ^ (v >> 27U)) * 0x94D049BB133111EBULL;
    return v ^ (v >> 31U);
}

/// Counts vertices around which triangles do not close up, in a table of 8 bytes for each vertex,
/// a mapped temporary file. Not thread-safe.
class BorderCount {
  public:
    /// Throws Error{io}.
    BorderCount(std::uint64_t vertices, const ScratchFolder& folder);

    /// REQUIRES: corners are numbers below `vertices`.
    void add(const ElementCorners& triangle);
    [[nodiscard]] std::uint64_t vertices() const;

  private:
    ScratchFile file_;
    std::span<std::uint64_t> balance_;
};

/// Of a welded mesh, and of triangles with vertices of a whole one. Throw Error{io, cancelled}.
std::uint64_t border_vertices(const PartStore& parts, const VertexNumbers& weld,
                              const ScratchFolder& folder, Progress& progress);
std::uint64_t border_vertices(const ScratchMesh& mesh, const CornerView& triangles,
                              const ScratchFolder& folder, Progress& progress);

}  // namespace isonest::detail
