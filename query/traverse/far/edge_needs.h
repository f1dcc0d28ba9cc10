// Which chunks a vertex on an edge of the nested grid is made from, where the store is far.
#pragma once

#include "query/march/finest_crossing.h"
#include "query/traverse/far/look_ahead.h"

namespace isonest::detail {

/// Not thread-safe; one per thread.
class EdgeNeeds {
  public:
    /// Both must outlive it.
    EdgeNeeds(ChunkCache& cache, const TraversalQuery& query);

    /// The attributes of a vertex on an edge, and where its vertex is exact, the place: as far as
    /// what was announced says. Throws what the cache throws.
    void edge(const Int3& a, double a_value, const Int3& b, double b_value, Wants& wants);
    /// Those of a vertex in a node.
    void node(const Int3& p, Wants& wants);
    /// The place alone.
    void crossing(const Int3& a, double a_value, const Int3& b, double b_value, Wants& wants);
    /// Lets go of all chunks.
    void leave() { values_.leave(); }

  private:
    void attributes(const Int3& a, const Int3& b, Wants& wants);
    void finer(const FinestCrossing::Edge& edge, int level, Wants& wants) const;

    const TraversalQuery& query_;
    const StoreLayout& layout_;
    NodeSampler values_;
};

}  // namespace isonest::detail
