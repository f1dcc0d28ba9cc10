// Values between the nodes of a level.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

#include <isonest/values.h>

#include "query/values/node_fields.h"
#include "query/values/node_sampler.h"
#include "store/base/vectors.h"
#include "store/container/format.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

/// The function that sample() evaluates, at points in world coordinates. Thread-safety: const.
class Interpolation {
  public:
    Interpolation(const StoreLayout& layout, const SampleOptions& options)
        : header_(layout.header()),
          rotation_(header_.rotation()),
          steps_(header_.steps()),
          level_(options.level),
          cells_(layout.lattice().cells_at(level_)),
          is_linear_(options.cells == Cells::tetrahedra) {}

    /// The place of a point in its cell.
    struct Place {
        Int3 cell;
        Double3 in_cell{};  ///< from 0 to 1 along each axis
    };
    /// The point in steps of the finest lattice from its first node.
    [[nodiscard]] Double3 steps_at(const Double3& point) const {
        const Double3& o = header_.origin;
        return steps_.steps_of(
            unrotated(rotation_, {point[0] - o[0], point[1] - o[1], point[2] - o[2]}));
    }
    /// nullopt outside the volume.
    [[nodiscard]] std::optional<Place> place_of(const Double3& point) const {
        constexpr double kRounding = 0x1p32;
        Double3 steps = steps_at(point);
        for (std::size_t a = 0; a < 3; ++a) {
            const int axis = static_cast<int>(a);
            steps[a] = std::nearbyint(steps[a] * kRounding) / kRounding;
            if (!(steps[a] >= 0 && steps[a] <= static_cast<double>(header_.nodes[axis] - 1))) {
                return std::nullopt;
            }
        }
        return place_in(steps);
    }
    /// The place of a point, given in steps of the finest lattice, in the nearest cell.
    [[nodiscard]] Place place_in(const Double3& steps) const {
        Place place;
        for (std::size_t a = 0; a < 3; ++a) {
            const int axis = static_cast<int>(a);
            const double last_node = static_cast<double>(header_.nodes[axis] - 1);
            const double at = std::ldexp(std::clamp(steps[a], 0.0, last_node), -level_);
            const std::int64_t last = std::max<std::int64_t>(cells_[axis] - 1, 0);
            place.cell[axis] = std::min(static_cast<std::int64_t>(at), last);
            place.in_cell[a] = at - static_cast<double>(place.cell[axis]);
        }
        return place;
    }

    [[nodiscard]] double value(NodeSampler& nodes, const Place& place) const {
        const double v = is_linear_ ? linear(nodes, place) : trilinear(nodes, place);
        return std::isfinite(v) ? v : std::numeric_limits<double>::quiet_NaN();
    }

  private:
    [[nodiscard]] double linear(NodeSampler& nodes, const Place& place) const {
        return linear_value(place.cell, place.in_cell, [&](const Int3& node) {
            return nodes.value(node * (std::int64_t{1} << level_), level_);
        });
    }

    [[nodiscard]] double trilinear(NodeSampler& nodes, const Place& place) const {
        double sum = 0;
        for (unsigned corner = 0; corner < 8; ++corner) {
            double weight = 1;
            Int3 node = place.cell;
            for (std::size_t a = 0; a < 3; ++a) {
                const bool high = (corner >> a & 1U) != 0;
                weight *= high ? place.in_cell[a] : 1 - place.in_cell[a];
                node[static_cast<int>(a)] += high ? 1 : 0;
            }
            if (weight > 0) {
                sum += weight * nodes.value(node * (std::int64_t{1} << level_), level_);
            }
        }
        return sum;
    }

    const StoreHeader& header_;
    Directions rotation_;
    LatticeSteps steps_;
    int level_;
    Int3 cells_;
    bool is_linear_;
};

}  // namespace isonest::detail
