#include "query/distance/element_polygon.h"

#include <cmath>

#include "query/march/crossing.h"

namespace isonest::detail {
namespace {

std::int64_t determinant(const Int3& a, const Int3& b, const Int3& c) {
    return a.x * (b.y * c.z - b.z * c.y) - a.y * (b.x * c.z - b.z * c.x) +
           a.z * (b.x * c.y - b.y * c.x);
}

class Builder {
  public:
    Builder(const Element<3>& t, double iso, const Double3& spacing, FinestCrossing& crossing)
        : t_(t), iso_(iso), spacing_(spacing), crossing_(crossing) {}

    /// Between a corner that is not below the isovalue and one that is.
    void add(std::size_t above, std::size_t below) {
        Double3 p{};
        Barycentric place{};
        if (t_.value[above] == iso_) {
            p = point(t_.v[above]);
            place[above] = 1;
        } else {
            const FinestCrossing::Edge edge = crossing_.finest(FinestCrossing::between(
                t_.v[above], t_.value[above], t_.v[below], t_.value[below]));
            const double s = edge.crossing(iso_);
            p = along(point(edge.from), s, minus(point(edge.to), point(edge.from)));
            const Double3 a = point(t_.v[above]);
            const Double3 b = point(t_.v[below]);
            std::size_t axis = 0;
            for (std::size_t i = 1; i < 3; ++i) {
                axis = std::fabs(b[i] - a[i]) > std::fabs(b[axis] - a[axis]) ? i : axis;
            }
            place[below] = (p[axis] - a[axis]) / (b[axis] - a[axis]);
            place[above] = 1 - place[below];
        }
        for (std::size_t axis = 0; axis < 3; ++axis) {
            p[axis] *= spacing_[axis];
        }
        polygon_.at[polygon_.count] = p;
        polygon_.place[polygon_.count++] = place;
    }
    [[nodiscard]] ElementPolygon polygon(bool is_crossed) {
        polygon_.is_crossed = is_crossed;
        return polygon_;
    }

  private:
    static Double3 point(const Int3& p) {
        return {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)};
    }
    const Element<3>& t_;
    double iso_;
    const Double3& spacing_;
    FinestCrossing& crossing_;
    ElementPolygon polygon_;
};

}  // namespace

bool is_positive(const Element<3>& t) {
    return determinant(t.v[1] - t.v[0], t.v[2] - t.v[0], t.v[3] - t.v[0]) > 0;
}

ElementPolygon element_polygon(const Element<3>& t, double iso, const Double3& spacing,
                               FinestCrossing& crossing) {
    unsigned mask = 0;
    for (unsigned i = 0; i < 4; ++i) {
        mask |= t.value[i] < iso ? 1U << i : 0U;
    }
    const Crossing& c = kCrossings[mask];
    const auto is_hit = [&](std::size_t i) { return t.value[c.order[i]] == iso; };
    Builder builder(t, iso, spacing, crossing);
    if (c.below == 1) {
        for (std::size_t i = 1; i < 4; ++i) {
            builder.add(c.order[i], c.order[0]);
        }
    } else if (c.below == 2 && !(is_hit(0) && is_hit(1))) {
        const bool outward = is_positive(t) != c.flip;
        const std::size_t r1 = c.order[outward ? 2 : 3];
        const std::size_t r2 = c.order[outward ? 3 : 2];
        builder.add(c.order[0], r1);
        builder.add(c.order[0], r2);
        builder.add(c.order[1], r2);
        builder.add(c.order[1], r1);
    } else if (c.below == 3 && !is_hit(0)) {
        for (std::size_t i = 1; i < 4; ++i) {
            builder.add(c.order[0], c.order[i]);
        }
    }
    return builder.polygon(c.below != 0 && c.below != 4);
}

}  // namespace isonest::detail
