// The lines of a mesh as chains: vertices in the order in which segments connect them.
#pragma once

#include <cstdint>
#include <span>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/growing_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Between two ends, which are all vertices that do not have two segments; or a closed loop.
struct Chain {
    std::uint64_t first = 0;     ///< place of its first vertex in LineChains::vertices()
    std::uint64_t vertices = 0;  ///< each once; of a loop the last is connected with the first
    std::uint32_t closed = 0;    ///< a loop
    /// Segments without which the topology may change: 3 of a loop, also of one that begins and
    /// ends at the same vertex with other segments; 2 where neither end is the end of all lines
    /// there, as another chain may connect the same two. No more than there are.
    std::uint32_t least = 1;

    [[nodiscard]] std::uint64_t segments() const { return vertices - 1 + closed; }
    /// Where vertex i lies; of a loop i may be as large as twice the number of vertices.
    [[nodiscard]] std::uint64_t place(std::uint64_t i) const {
        return first + (i < vertices ? i : i - vertices);
    }
};

/// Every segment of the mesh lies in exactly one chain. The order depends on the mesh alone. What
/// grows with it lies in temporary files. Thread-safety: constant once it is made.
class LineChains {
  public:
    /// `segments`: of vertices of `mesh`. REQUIRES: mesh.layout().corners == 2. Throws Error{io,
    /// cancelled}.
    LineChains(const ScratchMesh& mesh, const CornerView& segments, const ScratchFolder& folder,
               Progress& progress);

    [[nodiscard]] std::span<const Chain> chains() const { return chains_.all(); }
    /// Of all chains, one after the other: numbers in the mesh.
    [[nodiscard]] std::span<const std::uint64_t> vertices() const { return vertices_.all(); }
    /// Bytes of its temporary files, at most.

  private:
    GrowingFile<Chain> chains_;
    GrowingFile<std::uint64_t> vertices_;
};

}  // namespace isonest::detail
