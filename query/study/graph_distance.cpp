#include "query/study/graph_distance.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <vector>

#include "query/study/true_error.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kMaxVertices = 4;

GraphPoint difference(const GraphPoint& a, const GraphPoint& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]};
}

double product(const GraphPoint& a, const GraphPoint& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}

/// The weights of the vertices at the point of the affine hull nearest to p: the normal equations,
/// by Cholesky's elimination.
std::array<double, kMaxVertices> hull_weights(const GraphPoint& p,
                                              std::span<const GraphPoint> vertices) {
    const std::size_t n = vertices.size() - 1;
    std::array<GraphPoint, kMaxVertices - 1> edge{};
    std::array<std::array<double, kMaxVertices>, kMaxVertices - 1> m{};  // last column: right side
    const GraphPoint to = difference(p, vertices[0]);
    for (std::size_t i = 0; i < n; ++i) {
        edge[i] = difference(vertices[i + 1], vertices[0]);
    }
    for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t j = 0; j < n; ++j) {
            m[i][j] = product(edge[i], edge[j]);
        }
        m[i][n] = product(edge[i], to);
    }
    for (std::size_t i = 0; i < n; ++i) {
        for (std::size_t k = i + 1; k < n; ++k) {
            const double by = m[k][i] / m[i][i];
            for (std::size_t j = i; j <= n; ++j) {
                m[k][j] -= by * m[i][j];
            }
        }
    }
    std::array<double, kMaxVertices> weights{1};
    for (std::size_t i = n; i-- > 0;) {
        double sum = m[i][n];
        for (std::size_t j = i + 1; j < n; ++j) {
            sum -= m[i][j] * weights[j + 1];
        }
        weights[i + 1] = sum / m[i][i];
        weights[0] -= weights[i + 1];
    }
    return weights;
}

double squared_distance(const GraphPoint& p, std::span<const GraphPoint> vertices) {
    if (vertices.size() == 1) {
        const GraphPoint d = difference(p, vertices[0]);
        return product(d, d);
    }
    const std::array<double, kMaxVertices> weights = hull_weights(p, vertices);
    double best = std::numeric_limits<double>::infinity();
    bool inside = true;
    for (std::size_t i = 0; i < vertices.size(); ++i) {
        if (weights[i] >= 0) {
            continue;
        }
        inside = false;
        std::array<GraphPoint, kMaxVertices> facet{};
        std::size_t count = 0;
        for (std::size_t j = 0; j < vertices.size(); ++j) {
            if (j != i) {
                facet[count++] = vertices[j];
            }
        }
        best = std::min(best, squared_distance(p, std::span(facet.data(), count)));
    }
    if (!inside) {
        return best;
    }
    GraphPoint d = p;
    for (std::size_t i = 0; i < vertices.size(); ++i) {
        for (std::size_t a = 0; a < d.size(); ++a) {
            d[a] -= weights[i] * vertices[i][a];
        }
    }
    return product(d, d);
}

template <int D>
class Graphs {
  public:
    Graphs(const WholeLattice& whole, const Double3& spacing, double range)
        : whole_(whole),
          range_(range),
          walks_(axis_walks<D>(whole.lattice())),
          cells_(max(whole.lattice().nodes() - Int3{1, 1, 1}, {1, 1, 1})) {
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

    /// The error at the node: no point of a graph is further from the other graph.
    [[nodiscard]] double error(const Int3& p) const {
        const double e = std::fabs(whole_.projected(p) - whole_.exact(p)) / range_;
        return std::isfinite(e) ? e : 0;
    }
    /// Distance from the point of one graph at p to the other graph; `enough` if it is not larger.
    [[nodiscard]] double from(const Int3& p, bool of_data, double enough) const {
        const GraphPoint at = point(p, of_data);
        double best = error(p);
        for (std::int64_t ring = 0; best > enough && static_cast<double>(ring) * min_step_ < best;
             ++ring) {
            const Int3 reach{ring, ring, ring};
            const Int3 low = max(p - reach - Int3{1, 1, 1}, {0, 0, 0});
            const Int3 high = min(p + reach, cells_ - Int3{1, 1, 1});
            bool any = false;
            for_shell(p, ring, low, high, [&](const Int3& cell) {
                any = true;
                best = std::min(best, from_cell(at, cell, !of_data, best));
            });
            if (!any && ring > 0) {
                break;
            }
        }
        return std::max(best, enough);
    }

  private:
    [[nodiscard]] GraphPoint point(const Int3& p, bool of_data) const {
        GraphPoint at{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            at[axis] = step_[axis] * static_cast<double>(p[static_cast<int>(axis)]);
        }
        at[3] = (of_data ? whole_.exact(p) : whole_.projected(p)) / range_;
        return at;
    }
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
    [[nodiscard]] double from_cell(const GraphPoint& at, const Int3& cell, bool of_data,
                                   double best) const {
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
            const GraphPoint corner = point(cell + o, of_data);
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
            std::array<GraphPoint, D + 1> vertices{};
            bool complete = true;
            for (std::size_t i = 0; i < v.size(); ++i) {
                vertices[i] = point(v[i], of_data);
                complete = complete && std::isfinite(vertices[i][3]);
            }
            if (complete) {
                best = std::min(best, distance_to_simplex(at, vertices));
            }
        }
        return best;
    }

    const WholeLattice& whole_;
    double range_;
    std::vector<AxisWalk<D>> walks_;
    Int3 cells_;
    Double3 step_{};  ///< 0 along flat axes
    double min_step_ = std::numeric_limits<double>::infinity();
    unsigned flat_ = 7;
};

template <int D>
double distance_of(const WholeLattice& whole, const Double3& spacing, double range,
                   Progress& progress) {
    const Graphs<D> graphs(whole, spacing, range);
    const Int3 n = whole.lattice().nodes();
    std::atomic<double> largest{0};
    const auto try_node = [&](const Int3& p) {
        for (const bool of_data : {true, false}) {
            double known = largest;
            if (graphs.error(p) > known) {
                const double found = graphs.from(p, of_data, known);
                while (found > known && !largest.compare_exchange_weak(known, found)) {
                }
            }
        }
    };
    // The node with the largest error comes first: then few others can be the furthest.
    Int3 first;
    for (std::int64_t i = 0; i < n.product(); ++i) {
        const Int3 p = n.unlinear(i);
        first = graphs.error(p) > graphs.error(first) ? p : first;
    }
    try_node(first);
    tbb::parallel_for(std::int64_t{0}, n.y * n.z, [&](std::int64_t row) {
        progress.check();
        for (std::int64_t x = 0; x < n.x; ++x) {
            try_node({x, row % n.y, row / n.y});
        }
    });
    return largest;
}

}  // namespace

double distance_to_simplex(const GraphPoint& p, std::span<const GraphPoint> vertices) {
    return std::sqrt(squared_distance(p, vertices));
}

double graph_distance(const WholeLattice& whole, const Double3& spacing, double range,
                      Progress& progress) {
    switch (whole.lattice().dimension()) {
        case 1:
            return distance_of<1>(whole, spacing, range, progress);
        case 2:
            return distance_of<2>(whole, spacing, range, progress);
        default:
            return distance_of<3>(whole, spacing, range, progress);
    }
}

}  // namespace isonest::detail
