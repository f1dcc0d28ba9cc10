// U, its projection P U on an adaptive mesh, and an indicator, in all nodes of a volume in memory.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 2: P U is U at the nodes that are refined, and
// the mean of the ends of the refinement edge at all others.
#pragma once

#include <cstdint>
#include <vector>

#include <isonest/progress.h>

#include "query/study/node_index.h"
#include "query/traverse/adapt_traverse.h"
#include "query/traverse/lattice_plane.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

/// Norms of P U - U, relative to a range of values and to the size of what they are taken over.
struct ErrorNorms {
    double l1 = 0;
    double l2 = 0;
    double linf = 0;
};

class WholeLattice {
  public:
    explicit WholeLattice(const StoreLayout& layout);

    /// Bytes that it takes.
    static std::uint64_t heap(const StoreLayout& layout);

    /// Throws what ChunkCache throws.
    void load_values(ChunkCache& cache);
    /// Returns the largest finite value. Throws what ChunkCache throws, and Error{cancelled}.
    double load_indicator(ChunkCache& cache, Field field, Progress& progress);
    /// P U of the mesh that refines the nodes whose indicator is at least `threshold`.
    void project(double threshold);

    /// The elements of that mesh, those too that reach out of the volume; with a plane those that
    /// it cuts. `threads`: 0 = as many as the machine has. REQUIRES: a plane in a volume alone.
    [[nodiscard]] VisitCounts count(double threshold, const LatticePlane* plane, int threads) const;
    /// By the nodes of the finest lattice (the trapezoidal rule), without missing data.
    [[nodiscard]] ErrorNorms measure(double range) const;

    [[nodiscard]] const Lattice& lattice() const { return lattice_; }
    [[nodiscard]] double exact(const Int3& p) const { return exact_[number_.of(p)]; }
    [[nodiscard]] float indicator(const Int3& p) const { return eta_[number_.of(p)]; }
    /// At different nodes from different threads.
    void set_indicator(const Int3& p, float eta) { eta_[number_.of(p)] = eta; }
    [[nodiscard]] double projected(const Int3& p) const { return projected_[number_.of(p)]; }

  private:
    struct Numbers;
    [[nodiscard]] std::size_t at(const Int3& p) const { return number_.of(p); }
    void project_at(const Int3& p, const NodeInfo& node, double threshold);
    template <int D>
    [[nodiscard]] VisitCounts count_elements(double threshold, int threads) const;

    const StoreLayout& layout_;
    const Lattice& lattice_;
    NodeIndex number_;
    std::vector<double> exact_;
    std::vector<double> projected_;
    std::vector<float> eta_;
};

}  // namespace isonest::detail
