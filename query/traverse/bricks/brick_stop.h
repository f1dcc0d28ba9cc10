// The stop test in one brick of the fast path.
#pragma once

#include <cstdint>

#include "query/traverse/bricks/brick_interest.h"
#include "query/traverse/tolerance.h"

namespace isonest::detail {

/// Nodes whose field is below the query's tolerance stop. All members are decisions, or numbers for
/// them.
class BrickStop {
  public:
    BrickStop(TraversalRun& run, const BrickPlace& at)
        : tolerance_(run.query.tolerance),
          stride_(at.stride),
          is_bound_(run.query.stop == run.query.bound),
          field_(field_view(run, run.query.stop, at)) {}

    /// Whether no node stops: then none needs to be asked.
    [[nodiscard]] bool never() const { return tolerance_.is_zero(); }
    /// Whether the interest test's number is this test's as well.
    [[nodiscard]] bool is_bound() const { return is_bound_; }
    /// The field at a refinement node of the cube's tetrahedra, and at a subcube's centre. The
    /// latter REQUIRES: the level is not 0.
    [[nodiscard]] double number(const CubeNodes& nodes, int position) const {
        return field_.at(nodes.value, nodes.low, nodes.mirror, position);
    }
    [[nodiscard]] double centre(const Int3& cube) const { return field_.centre(cube); }
    [[nodiscard]] bool stops(const CubeNodes& nodes, int position, double eta) const {
        const Int3 twice = (nodes.low + node_offset(position, nodes.mirror)) * (2 * stride_);
        return tolerance_.stops(eta, twice, 2 * stride_);
    }
    [[nodiscard]] bool stops_centre(const Int3& cube, double eta) const {
        return tolerance_.stops(eta, (cube * 2 + Int3{1, 1, 1}) * stride_, stride_);
    }

  private:
    const Tolerance& tolerance_;
    std::int64_t stride_;
    bool is_bound_;
    FieldView field_;
};

}  // namespace isonest::detail
