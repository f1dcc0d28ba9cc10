#include "query/surface_nets/net_layer.h"

#include <algorithm>
#include <bit>

namespace isonest::detail {
namespace {

/// Of a cell whose lowest corner is node `at`: bit 2 axis + side if a node on that side is slim
/// along the axis.
std::uint8_t slim_sides(std::span<const std::uint8_t> below, std::span<const std::uint8_t> above,
                        std::size_t at, std::size_t row) {
    // Corners by number x + 2 y + 4 z.
    const std::array<unsigned, 8> slim{below[at],           below[at + 1],      below[at + row],
                                       below[at + row + 1], above[at],          above[at + 1],
                                       above[at + row],     above[at + row + 1]};
    unsigned sides = 0;
    for (std::size_t corner = 0; corner < slim.size(); ++corner) {
        for (unsigned axis = 0; axis < 3; ++axis) {
            const auto side = static_cast<unsigned>(corner >> axis & 1U);
            sides |= (slim.at(corner) >> axis & 1U) << (2 * axis + side);
        }
    }
    return static_cast<std::uint8_t>(sides);
}

}  // namespace

void find_slim(std::span<const std::int64_t> before, std::span<const std::int64_t> plane,
               std::span<const std::int64_t> after, const Int3& nodes,
               std::vector<std::uint8_t>& slim) {
    slim.assign(plane.size(), 0);
    for (std::int64_t y = 1; y + 1 < nodes.y; ++y) {
        for (std::int64_t x = 1; x + 1 < nodes.x; ++x) {
            const auto i = static_cast<std::size_t>(y * nodes.x + x);
            const auto row = static_cast<std::size_t>(nodes.x);
            const std::int64_t label = plane[i];
            const unsigned axes = (plane[i - 1] != label && plane[i + 1] != label ? 1U : 0U) |
                                  (plane[i - row] != label && plane[i + row] != label ? 2U : 0U) |
                                  (before[i] != label && after[i] != label ? 4U : 0U);
            if (std::popcount(axes) > 1) {
                slim[i] = static_cast<std::uint8_t>(axes);
            }
        }
    }
}

void NetLayer::begin(const NetPlane& below, const NetPlane& above, const Int3& nodes,
                     unsigned held) {
    rows_.assign(1, 0);
    x_.clear();
    neighbours_.clear();
    held_.clear();
    slim_.clear();
    const std::int64_t width = nodes.x - 1;
    const std::int64_t height = nodes.y - 1;
    for (std::int64_t y = 0; y < height; ++y) {
        const std::int64_t* const a = below.label.data() + y * nodes.x;
        const std::int64_t* const b = a + nodes.x;
        const std::int64_t* const c = above.label.data() + y * nodes.x;
        const std::int64_t* const d = c + nodes.x;
        const auto same_at = [&](std::int64_t x) {
            return a[x] == b[x] && a[x] == c[x] && a[x] == d[x];
        };
        const unsigned held_y =
            (y == 0 && (held & 4U) != 0) || (y + 1 == height && (held & 8U) != 0) ? 2U : 0U;
        const unsigned held_yz = held_y | ((held & 48U) != 0 ? 4U : 0U);
        bool same = same_at(0);
        for (std::int64_t x = 0; x < width; ++x) {
            const bool same_next = same_at(x + 1);
            const bool uniform = same && same_next && a[x] == a[x + 1];
            same = same_next;
            if (uniform) {
                continue;
            }
            x_.push_back(static_cast<std::uint16_t>(x));
            neighbours_.push_back(
                neighbours_of({a[x], a[x + 1], b[x], b[x + 1], c[x], c[x + 1], d[x], d[x + 1]}));
            const bool held_x =
                (x == 0 && (held & 1U) != 0) || (x + 1 == width && (held & 2U) != 0);
            held_.push_back(static_cast<std::uint8_t>(held_yz | (held_x ? 1U : 0U)));
            const auto at = static_cast<std::size_t>(y * nodes.x + x);
            slim_.push_back(
                slim_sides(below.slim, above.slim, at, static_cast<std::size_t>(nodes.x)));
        }
        rows_.push_back(static_cast<std::uint32_t>(x_.size()));
    }
    at_.assign(x_.size(), {});
    before_.assign(x_.size(), {});
    number_.assign(x_.size(), 0);
}

void NetLayer::move(const NetLayer* below, const NetLayer* above, float weight) {
    using Point = std::array<float, 3>;
    for (std::int64_t y = 0; y < row_count(); ++y) {
        NetRowCursor front(this, y - 1);
        NetRowCursor back(this, y + 1);
        NetRowCursor under(below, y);
        NetRowCursor over(above, y);
        const std::uint32_t end = row(y + 1);
        for (std::uint32_t i = row(y); i < end; ++i) {
            const std::int64_t x = x_[i];
            const unsigned neighbours = neighbours_[i];
            Point sum{};
            unsigned count = 0;
            const auto add = [&](const std::vector<Point>& places, std::uint32_t vertex,
                                 std::size_t axis, float step) {
                if (vertex != NetRowCursor::kNone) {
                    const Point& p = places[vertex];
                    sum[0] += p[0];
                    sum[1] += p[1];
                    sum[2] += p[2];
                    sum[axis] += step;
                    ++count;
                }
            };
            // Always in this order, so that every block rounds alike.
            if ((neighbours & 1U) != 0 && i > row(y) && x_[i - 1] + 1 == x) {
                add(at_, i - 1, 0, -1);
            }
            if ((neighbours & 2U) != 0 && i + 1 < end && x_[i + 1] == x + 1) {
                add(at_, i + 1, 0, 1);
            }
            if ((neighbours & 4U) != 0) {
                add(at_, front.find(x), 1, -1);
            }
            if ((neighbours & 8U) != 0) {
                add(at_, back.find(x), 1, 1);
            }
            if ((neighbours & 16U) != 0 && below != nullptr) {
                add(below->before_, under.find(x), 2, -1);
            }
            if ((neighbours & 32U) != 0 && above != nullptr) {
                add(above->at_, over.find(x), 2, 1);
            }
            Point p = at_[i];
            if (count > 0) {
                const float share = 1.0F / static_cast<float>(count);
                for (std::size_t axis = 0; axis < 3; ++axis) {
                    const float to = p[axis] + weight * (sum[axis] * share - p[axis]);
                    const unsigned slim = slim_[i] >> (2 * axis);
                    p[axis] =
                        (held_[i] >> axis & 1U) != 0
                            ? 0.0F
                            : std::clamp(to, (slim & 1U) != 0 ? -kMostMovedToSlim : -kMostMoved,
                                         (slim & 2U) != 0 ? kMostMovedToSlim : kMostMoved);
                }
            }
            before_[i] = p;
        }
    }
    std::swap(at_, before_);
}

}  // namespace isonest::detail
