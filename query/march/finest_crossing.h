// Where the finest function has the isovalue on an edge of the nested grid.
#pragma once

#include <cmath>

#include <isonest/int3.h>

#include "query/view/node_sampler.h"

namespace isonest::detail {

/// Where from 0 to 1 the linear function from one value to the other has the isovalue. REQUIRES:
/// the values are finite, and one of them is below.
inline double crossing_of(double from, double to, double iso) {
    const double t = (iso - from) / (to - from);
    return std::isfinite(to - from) ? t : (iso / 4 - from / 4) / (to / 4 - from / 4);
}

/// An edge of the nested grid is only ever halved, so it is a chain of edges of the finest mesh.
/// The crossing is looked for by halving: it depends on the edge alone, and all tetrahedra at the
/// edge get the same one, whatever their level. Not thread-safe; one per thread.
class FinestCrossing {
  public:
    FinestCrossing(ChunkCache& cache, double iso) : nodes_(cache), iso_(iso) {}

    /// Nodes of the finest lattice, and the values there; one is below the isovalue.
    struct Edge {
        Int3 from;
        Int3 to;
        double from_value = 0;
        double to_value = 0;

        /// Where along it, from 0 to 1, the linear function has the isovalue.
        [[nodiscard]] double crossing(double iso) const {
            return crossing_of(from_value, to_value, iso);
        }
    };
    /// The edge between two nodes, in an order that depends on the nodes alone.
    static Edge between(const Int3& a, double a_value, const Int3& b, double b_value);
    /// The finest edge of the chain whose ends are on different sides, from `from` on the first
    /// that halving finds; or the shortest one around a missing value in the middle. Throws what
    /// the cache throws.
    [[nodiscard]] Edge finest(Edge edge);
    /// Lets go of all chunks.
    void leave() { nodes_.leave(); }
    /// How many chunks of values are held at most, in a store of so many levels.
    static std::uint64_t most_chunks(int levels) { return static_cast<std::uint64_t>(levels); }

  private:
    NodeSampler nodes_;
    double iso_;
};

}  // namespace isonest::detail
