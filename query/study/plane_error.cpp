#include "query/study/plane_error.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "query/study/finest_elements.h"
#include "query/study/linear_power.h"
#include "store/base/vector3.h"

namespace isonest::detail {
namespace {

/// Integrals over a part of the plane.
struct Sums {
    double area = 0;
    double l1 = 0;
    double l2 = 0;
    double linf = 0;

    void add(const Sums& other) {
        area += other.area;
        l1 += other.l1;
        l2 += other.l2;
        linf = std::max(linf, other.linf);
    }
};

/// A point of the plane on an edge of an element, and the error there.
struct Point {
    Double3 at{};
    double error = 0;
};

class Section {
  public:
    Section(const WholeLattice& whole, const LatticePlane& plane, const Double3& spacing,
            double range)
        : whole_(whole),
          plane_(plane),
          spacing_(spacing),
          range_(range),
          walks_(axis_walks<3>(whole.lattice())) {}

    /// Of the cells between the planes z and z + 1 of nodes.
    [[nodiscard]] Sums layer(std::int64_t z) const {
        Sums sums;
        for (std::int64_t y = 0; y + 1 < whole_.lattice().nodes().y; ++y) {
            const auto [first, end] = cut_in_row(y, z);
            for (std::int64_t x = first; x < end; ++x) {
                if (is_cut({x, y, z})) {
                    for (const AxisWalk<3>& walk : walks_) {
                        add(finest_element<3>({x, y, z}, walk), sums);
                    }
                }
            }
        }
        return sums;
    }

  private:
    /// All cells of a row that the plane cuts are among those from the first number to the second.
    [[nodiscard]] std::pair<std::int64_t, std::int64_t> cut_in_row(std::int64_t y,
                                                                   std::int64_t z) const {
        const std::int64_t cells = whole_.lattice().nodes().x - 1;
        const std::array<double, 4> at{plane_.distance({0, y, z}), plane_.distance({0, y + 1, z}),
                                       plane_.distance({0, y, z + 1}),
                                       plane_.distance({0, y + 1, z + 1})};
        const auto [low, high] = std::minmax_element(at.begin(), at.end());
        const double slope = plane_.normal[0];
        const double last = slope * static_cast<double>(cells);
        // More than sums are rounded by.
        const double margin = 1e-6 * (*high - *low + std::fabs(slope));
        if (*low + std::min(0.0, last) > margin || *high + std::max(0.0, last) < -margin) {
            return {0, 0};
        }
        if (std::fabs(last) <= *high - *low) {
            return {0, cells};
        }
        const auto crossing = [&](double distance) {
            return std::clamp(-distance / slope, -1.0, static_cast<double>(cells));
        };
        const double a = crossing(*low);
        const double b = crossing(*high);
        const double from = std::min(a, b);
        const double to = std::max(a, b);
        return {std::max<std::int64_t>(static_cast<std::int64_t>(std::floor(from)) - 1, 0),
                std::min(static_cast<std::int64_t>(std::ceil(to)) + 1, cells)};
    }
    [[nodiscard]] bool is_cut(const Int3& cell) const {
        bool below = false;
        bool not_below = false;
        for (std::int64_t i = 0; i < 8; ++i) {
            const double distance = plane_.distance(cell + Int3{2, 2, 2}.unlinear(i));
            (distance < 0 ? below : not_below) = true;
        }
        return below && not_below;
    }

    void add(const std::array<Int3, 4>& v, Sums& sums) const {
        std::array<double, 4> distance{};
        std::array<double, 4> error{};
        std::array<std::size_t, 4> order{};  // those below first
        std::size_t below = 0;
        std::size_t others = 4;
        for (std::size_t i = 0; i < 4; ++i) {
            distance[i] = plane_.distance(v[i]);
            order[distance[i] < 0 ? below++ : --others] = i;
        }
        if (below == 0 || below == 4) {
            return;
        }
        for (std::size_t i = 0; i < 4; ++i) {
            error[i] = (whole_.projected(v[i]) - whole_.exact(v[i])) / range_;
            if (!std::isfinite(error[i]) || !std::isfinite(whole_.exact(v[i]))) {
                return;
            }
        }
        const auto point = [&](std::size_t i, std::size_t j) {
            const double t = distance[i] / (distance[i] - distance[j]);
            Point p;
            for (int axis = 0; axis < 3; ++axis) {
                const auto from = static_cast<double>(v[i][axis]);
                const auto to = static_cast<double>(v[j][axis]);
                p.at[static_cast<std::size_t>(axis)] =
                    (from + t * (to - from)) * spacing_[static_cast<std::size_t>(axis)];
            }
            p.error = error[i] + t * (error[j] - error[i]);
            return p;
        };
        if (below != 2) {
            const std::size_t single = below == 1 ? order[0] : order[3];
            const std::size_t first = below == 1 ? 1 : 0;
            triangle(point(single, order[first]), point(single, order[first + 1]),
                     point(single, order[first + 2]), sums);
            return;
        }
        const Point a = point(order[0], order[2]);
        const Point c = point(order[1], order[3]);
        triangle(a, point(order[0], order[3]), c, sums);
        triangle(a, c, point(order[1], order[2]), sums);
    }

    static void triangle(const Point& a, const Point& b, const Point& c, Sums& sums) {
        const auto edge = [&](const Point& to) {
            return Double3{to.at[0] - a.at[0], to.at[1] - a.at[1], to.at[2] - a.at[2]};
        };
        const double area = length(cross(edge(b), edge(c))) / 2;
        const std::array<double, 3> error{a.error, b.error, c.error};
        sums.area += area;
        sums.l1 += area * mean_of_power(error, 1);
        sums.l2 += area * mean_of_power(error, 2);
        for (const double e : error) {
            sums.linf = std::max(sums.linf, std::fabs(e));
        }
    }

    const WholeLattice& whole_;
    LatticePlane plane_;
    Double3 spacing_;
    double range_;
    std::vector<AxisWalk<3>> walks_;
};

}  // namespace

ErrorNorms plane_error(const WholeLattice& whole, const LatticePlane& plane, const Double3& spacing,
                       double range) {
    const Section section(whole, plane, spacing, range);
    std::vector<Sums> layers(static_cast<std::size_t>(whole.lattice().nodes().z - 1));
    tbb::parallel_for(std::size_t{0}, layers.size(), [&](std::size_t z) {
        layers[z] = section.layer(static_cast<std::int64_t>(z));
    });
    Sums sums;
    for (const Sums& layer : layers) {
        sums.add(layer);
    }
    ErrorNorms norms;
    if (sums.area > 0) {
        norms.l1 = sums.l1 / sums.area;
        norms.l2 = std::sqrt(sums.l2 / sums.area);
        norms.linf = sums.linf;
    }
    return norms;
}

}  // namespace isonest::detail
