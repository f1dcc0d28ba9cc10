// The search for the point of a graph that is nearest to a given one, in rings of cells.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "query/study/graph_distance.h"
#include "query/study/true_error.h"
#include "query/study/whole_lattice.h"

namespace isonest::detail {

/// The graphs of functions that are linear on the elements of the finest level.
template <int D>
class GraphSearch {
  public:
    /// `range`: of the values, greater than 0. See graph_distance() for the units.
    GraphSearch(const Lattice& lattice, const Double3& spacing, double range)
        : range_(range),
          walks_(axis_walks<D>(lattice)),
          cells_(max(lattice.nodes() - Int3{1, 1, 1}, {1, 1, 1})) {
        double longest = 0;
        for (const std::size_t axis : walks_.front().axes) {
            longest = std::max(longest,
                               spacing[axis] * static_cast<double>(cells_[static_cast<int>(axis)]));
        }
        for (const std::size_t axis : walks_.front().axes) {
            step_[axis] = spacing[axis] / longest;
            min_step_ = std::min(min_step_, step_[axis]);
            flat_ &= ~(1U << axis);
        }
    }

    [[nodiscard]] GraphPoint point(const Int3& p, double value) const {
        GraphPoint at{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            at[axis] = step_[axis] * static_cast<double>(p[static_cast<int>(axis)]);
        }
        at[3] = value / range_;
        return at;
    }

    /// Distance from a point over node p to the graph of the function with `value(node)`, over the
    /// finest elements for which within(vertices) holds; `enough` if it is not larger. `best`: an
    /// upper bound of it. Missing values belong to no graph.
    template <class Value, class Within>
    [[nodiscard]] double distance(const GraphPoint& at, const Int3& p, double best, double enough,
                                  const Value& value, const Within& within) const {
        for (std::int64_t ring = 0; best > enough && static_cast<double>(ring) * min_step_ < best;
             ++ring) {
            const Int3 reach{ring, ring, ring};
            const Int3 low = max(p - reach - Int3{1, 1, 1}, {0, 0, 0});
            const Int3 high = min(p + reach, cells_ - Int3{1, 1, 1});
            bool any = false;
            for_shell(p, ring, low, high, [&](const Int3& cell) {
                any = true;
                best = std::min(best, from_cell(at, cell, best, value, within));
            });
            if (!any && ring > 0) {
                break;
            }
        }
        return std::max(best, enough);
    }

  private:
    /// The cells from `low` to `high` that are `ring` cells away from those around p.
    template <class F>
    void for_shell(const Int3& p, std::int64_t ring, const Int3& low, const Int3& high,
                   const F& f) const {
        const auto on_shell = [&](int axis, std::int64_t c) {
            return (flat_ >> static_cast<unsigned>(axis) & 1U) == 0 &&
                   (c == p[axis] + ring || c == p[axis] - ring - 1);
        };
        for (std::int64_t z = low.z; z <= high.z; ++z) {
            for (std::int64_t y = low.y; y <= high.y; ++y) {
                if (ring == 0 || on_shell(2, z) || on_shell(1, y)) {
                    for (std::int64_t x = low.x; x <= high.x; ++x) {
                        f({x, y, z});
                    }
                    continue;
                }
                for (const std::int64_t x : {p.x - ring - 1, p.x + ring}) {
                    if (x >= low.x && x <= high.x && on_shell(0, x)) {
                        f({x, y, z});
                    }
                }
            }
        }
    }
    template <class Value, class Within>
    [[nodiscard]] double from_cell(const GraphPoint& at, const Int3& cell, double best,
                                   const Value& value, const Within& within) const {
        const Int3 far{(flat_ & 1U) != 0 ? 0 : 1, (flat_ & 2U) != 0 ? 0 : 1,
                       (flat_ & 4U) != 0 ? 0 : 1};
        GraphPoint low{};
        GraphPoint high{};
        low[3] = std::numeric_limits<double>::infinity();
        high[3] = -low[3];
        for (std::int64_t i = 0; i < 8; ++i) {
            const Int3 o = Int3{2, 2, 2}.unlinear(i);
            if (min(o, far) != o) {
                continue;
            }
            const GraphPoint corner = point(cell + o, value(cell + o));
            for (std::size_t a = 0; a < 3; ++a) {
                low[a] = i == 0 ? corner[a] : low[a];
                high[a] = std::max(low[a], corner[a]);
            }
            low[3] = std::min(low[3], corner[3]);
            high[3] = std::max(high[3], corner[3]);
        }
        // A box around the cell's part of the graph.
        double square = 0;
        for (std::size_t a = 0; a < 4; ++a) {
            const double d = std::max({low[a] - at[a], at[a] - high[a], 0.0});
            square += d * d;
        }
        if (!(square < best * best)) {
            return best;
        }
        for (const AxisWalk<D>& walk : walks_) {
            const std::array<Int3, D + 1> v = finest_element<D>(cell, walk);
            if (!within(v)) {
                continue;
            }
            std::array<GraphPoint, D + 1> vertices{};
            bool complete = true;
            for (std::size_t i = 0; i < v.size(); ++i) {
                vertices[i] = point(v[i], value(v[i]));
                complete = complete && std::isfinite(vertices[i][3]);
            }
            if (complete) {
                best = std::min(best, distance_to_simplex(at, vertices));
            }
        }
        return best;
    }

    double range_;
    std::vector<AxisWalk<D>> walks_;
    Int3 cells_;
    Double3 step_{};  ///< 0 along flat axes
    double min_step_ = std::numeric_limits<double>::infinity();
    unsigned flat_ = 7;
};

}  // namespace isonest::detail
