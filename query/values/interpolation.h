// Values between the nodes of a level.
#pragma once

#include <algorithm>
#include <array>
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
          is_linear_(options.cells == Cells::tetrahedra) {
        require_not_curved(header_, {}, "interpolation at points of the world");
        LatticeSteps shortest = steps_;
        shortest.along = steps_.min_along();
        shortest.uneven = nullptr;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            Double3 unit{};
            unit[axis] = 1;
            unit_steps_[axis] = shortest.steps_of(unrotated(rotation_, unit));
        }
    }

    /// The place of a point in its cell.
    struct Place {
        Int3 cell;
        Double3 in_cell{};  ///< from 0 to 1 along each axis
    };
    [[nodiscard]] const LatticeSteps& steps() const { return steps_; }
    /// The point in own axes, relative to the first node.
    [[nodiscard]] Double3 relative(const Double3& point) const {
        const Double3& o = header_.origin;
        return unrotated(rotation_, {point[0] - o[0], point[1] - o[1], point[2] - o[2]});
    }
    /// The point in steps of the finest lattice from its first node.
    [[nodiscard]] Double3 steps_at(const Double3& point) const {
        return steps_.steps_of(relative(point));
    }
    /// How far, in steps along each axis, the vertex of a mesh in float32 may be from the place
    /// that it was made for, at the border of the volume for example.
    [[nodiscard]] Double3 slack_of_float(const Double3& point) const {
        // Coordinates are rounded to 24 bits. A vertex may also have been moved by a few units in
        // the last place, to give a triangle an area.
        constexpr double kRounding = 0x1p-22;
        Double3 slack{};
        for (std::size_t a = 0; a < 3; ++a) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                slack[a] += kRounding * std::fabs(point[axis] * unit_steps_[axis][a]);
            }
        }
        return slack;
    }
    /// nullopt outside the volume. Points outside by at most `slack` steps along each axis are
    /// moved to the border.
    [[nodiscard]] std::optional<Place> place_of(const Double3& point,
                                                const Double3& slack = {}) const {
        constexpr double kRounding = 0x1p32;
        Double3 steps = steps_at(point);
        for (std::size_t a = 0; a < 3; ++a) {
            const int axis = static_cast<int>(a);
            steps[a] = std::nearbyint(steps[a] * kRounding) / kRounding;
            const auto last = static_cast<double>(header_.nodes[axis] - 1);
            if (!(steps[a] >= -slack[a] && steps[a] <= last + slack[a])) {
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
            const auto last_node = static_cast<double>(header_.nodes[axis] - 1);
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
    std::array<Double3, 3> unit_steps_{};  ///< steps of a unit of length along each world axis;
                                           ///< uneven axes: at most
};

}  // namespace isonest::detail
