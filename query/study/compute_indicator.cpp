#include "query/study/compute_indicator.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "store/base/vector3.h"

namespace isonest::detail {
namespace {

constexpr float kMissing = std::numeric_limits<float>::infinity();

/// First and second derivatives of U on the finest lattice, by central differences; at the border
/// those of the nearest nodes that have neighbours.
class Derivatives {
  public:
    Derivatives(const WholeLattice& whole, const Double3& spacing)
        : whole_(whole), spacing_(spacing), last_(whole.lattice().nodes() - Int3{1, 1, 1}) {}

    [[nodiscard]] Double3 gradient(const Int3& node) const {
        const Int3 p = min(node, last_);
        Double3 g{};
        for (int axis = 0; axis < 3; ++axis) {
            if (last_[axis] > 0) {
                const auto [low, high] = around(p, axis);
                g[static_cast<std::size_t>(axis)] =
                    (whole_.exact(high) - whole_.exact(low)) / distance(low, high, axis);
            }
        }
        return g;
    }
    /// sqrt(k1^2 + k2^2) = |P H P| / |grad U| in the norm of Frobenius, P projecting along the
    /// gradient (the shape operator of a level set).
    [[nodiscard]] double curvature(const Int3& node) const {
        const Double3 g = gradient(node);
        const double size = length(g);
        if (!(size > 0)) {
            return std::isnan(size) ? size : 0;
        }
        std::array<Double3, 3> h{};
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) {
                h[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] = second(node, i, j);
            }
        }
        std::array<Double3, 3> project{};
        for (std::size_t i = 0; i < 3; ++i) {
            for (std::size_t j = 0; j < 3; ++j) {
                project[i][j] = (i == j ? 1 : 0) - g[i] * g[j] / (size * size);
            }
        }
        double square = 0;
        for (std::size_t i = 0; i < 3; ++i) {
            for (std::size_t j = 0; j < 3; ++j) {
                double entry = 0;
                for (std::size_t k = 0; k < 3; ++k) {
                    entry += project[i][k] * dot(h[k], project[j]);
                }
                square += entry * entry;
            }
        }
        return std::sqrt(square) / size;
    }

  private:
    [[nodiscard]] std::pair<Int3, Int3> around(const Int3& p, int axis) const {
        std::pair<Int3, Int3> ends{p, p};
        ends.first[axis] = std::max<std::int64_t>(p[axis] - 1, 0);
        ends.second[axis] = std::min(p[axis] + 1, last_[axis]);
        return ends;
    }
    [[nodiscard]] double distance(const Int3& low, const Int3& high, int axis) const {
        return static_cast<double>(high[axis] - low[axis]) *
               spacing_[static_cast<std::size_t>(axis)];
    }
    [[nodiscard]] double second(const Int3& node, int i, int j) const {
        if (last_[i] < 2 || last_[j] < 2) {
            return 0;
        }
        Int3 p = min(node, last_);
        for (const int axis : {i, j}) {
            p[axis] = std::clamp<std::int64_t>(p[axis], 1, last_[axis] - 1);
        }
        const auto [low, high] = around(p, i);
        const double step = distance(low, high, i);
        if (i == j) {
            return (whole_.exact(high) - 2 * whole_.exact(p) + whole_.exact(low)) /
                   (step * step / 4);
        }
        const auto slope = [&](const Int3& q) {
            const auto [from, to] = around(q, j);
            return (whole_.exact(to) - whole_.exact(from)) / distance(from, to, j);
        };
        return (slope(high) - slope(low)) / step;
    }

    const WholeLattice& whole_;
    Double3 spacing_;
    Int3 last_;
};

/// Calls f(p, node) for the refinement nodes of a level, in parallel.
template <class F>
void for_nodes_of(const Lattice& lattice, int level, Progress& progress, const F& f) {
    const std::int64_t scale = std::int64_t{1} << (level - 1);
    const Int3 size = lattice.cells_at(level) * 2 + Int3{1, 1, 1};
    tbb::parallel_for(std::int64_t{0}, size.z, [&](std::int64_t z) {
        progress.check();
        for (std::int64_t i = 0; i < size.x * size.y; ++i) {
            const Int3 p = Int3{i % size.x, i / size.x, z} * scale;
            const NodeInfo node = describe_node(p, lattice.top());
            if (node.scale == scale) {
                f(p, node);
            }
        }
    });
}

/// Calls f(child) for the nodes that are refined after it.
template <class F>
void for_children(const Lattice& lattice, const Int3& p, const NodeInfo& node, const F& f) {
    if (node.kind != NodeKind::edge) {
        for (int axis = 0; axis < 3; ++axis) {
            if (node.odd[static_cast<std::size_t>(axis)]) {
                Int3 step;
                step[axis] = node.scale;
                f(p - step);
                f(p + step);
            }
        }
        return;
    }
    if (node.scale == 1) {
        return;
    }
    const std::int64_t half = node.scale / 2;
    const Int3 cells = lattice.cells_at(node.level() - 1);
    for (std::int64_t i = 0; i < 8; ++i) {
        const Int3 side = Int3{2, 2, 2}.unlinear(i);
        Int3 child = p;
        bool exists = true;
        for (int axis = 0; axis < 3; ++axis) {
            if (cells[axis] == 0) {
                exists = exists && side[axis] == 0;
                continue;
            }
            child[axis] += side[axis] == 0 ? -half : half;
            const std::int64_t low = child[axis] - half;
            exists = exists && low >= 0 && low / node.scale < cells[axis];
        }
        if (exists) {
            f(child);
        }
    }
}

}  // namespace

double compute_indicator(WholeLattice& whole, const ComputedField& field, const Double3& spacing,
                         Progress& progress) {
    const Lattice& lattice = whole.lattice();
    const bool by_offset =
        field.indicator == ComputedIndicator::lp || field.indicator == ComputedIndicator::grad_lp;
    std::optional<OffsetFactors> factors;
    if (by_offset && lattice.dimension() > 0) {
        factors.emplace(lattice, spacing, field);
    }
    const Derivatives derivatives(whole, spacing);
    const auto raw = [&](const Int3& p, const NodeInfo& node) {
        const double offset =
            whole.exact(p) - (whole.exact(node.end0) + whole.exact(node.end1)) / 2;
        if (!std::isfinite(offset)) {
            return kMissing;
        }
        double eta = 0;
        if (by_offset) {
            eta = std::fabs(offset) * factors->of(p, node);
        } else if (field.indicator == ComputedIndicator::gradient) {
            eta = length(derivatives.gradient(p));
        } else {
            eta = derivatives.curvature(p);
        }
        return std::isfinite(eta) ? static_cast<float>(eta) : kMissing;
    };
    for (int level = 1; level <= lattice.top(); ++level) {
        for_nodes_of(lattice, level, progress, [&](const Int3& p, const NodeInfo& node) {
            whole.set_indicator(p, raw(p, node));
        });
        for (const NodeKind kind : {NodeKind::edge, NodeKind::face, NodeKind::centre}) {
            for_nodes_of(lattice, level, progress, [&](const Int3& p, const NodeInfo& node) {
                if (!field.saturation || node.kind != kind) {
                    return;
                }
                float most = 0;
                for_children(lattice, p, node, [&](const Int3& child) {
                    most = std::max(most, whole.indicator(child));
                });
                const float eta = whole.indicator(p);
                const bool bar = *field.saturation == Saturation::bar;
                whole.set_indicator(p, bar ? std::max(eta, most) : eta + most);
            });
        }
    }
    double largest = 0;
    for (int level = 1; level <= lattice.top(); ++level) {
        const std::int64_t scale = std::int64_t{1} << (level - 1);
        const Int3 size = lattice.cells_at(level) * 2 + Int3{1, 1, 1};
        std::vector<float> rows(static_cast<std::size_t>(size.z), 0);
        for_nodes_of(lattice, level, progress, [&](const Int3& p, const NodeInfo&) {
            const float eta = whole.indicator(p);
            float& row = rows[static_cast<std::size_t>(p.z / scale)];
            row = std::isfinite(eta) ? std::max(row, eta) : row;
        });
        largest =
            std::max(largest, static_cast<double>(*std::max_element(rows.begin(), rows.end())));
    }
    return largest;
}

}  // namespace isonest::detail
