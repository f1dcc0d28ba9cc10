#include "query/study/graph_distance.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include "query/study/graph_search.h"

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
        : whole_(whole), range_(range), search_(whole.lattice(), spacing, range) {}

    /// The error at the node: no point of a graph is further from the other graph.
    [[nodiscard]] double error(const Int3& p) const {
        const double e = std::fabs(whole_.projected(p) - whole_.exact(p)) / range_;
        return std::isfinite(e) ? e : 0;
    }
    /// Distance from the point of one graph at p to the other graph; `enough` if it is not larger.
    [[nodiscard]] double from(const Int3& p, bool of_data, double enough) const {
        const auto value = [&](const Int3& q, bool data) {
            return data ? whole_.exact(q) : whole_.projected(q);
        };
        return search_.distance(
            search_.point(p, value(p, of_data)), p, error(p), enough,
            [&](const Int3& q) { return value(q, !of_data); },
            [](const std::array<Int3, D + 1>&) { return true; });
    }

  private:
    const WholeLattice& whole_;
    double range_;
    GraphSearch<D> search_;
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
