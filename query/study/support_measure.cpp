#include "query/study/support_measure.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "query/study/graph_search.h"
#include "query/study/true_error.h"
#include "query/traverse/adapt_traverse.h"
#include "store/base/vectors.h"
#include "store/lattice/simplex.h"

namespace isonest::detail {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The elements that are bisected at a node, without recursion from the coarsest ones: those at a
/// node of scale 1 whose even coordinates are 0, scaled, moved and mirrored.
template <int D>
class Diamonds {
  public:
    explicit Diamonds(const Lattice& lattice) : lattice_(lattice) {
        const Int3& n = lattice.nodes();
        const Lattice cube({n.x > 1 ? 3 : 1, n.y > 1 ? 3 : 1, n.z > 1 ? 3 : 1});
        std::vector<Element<D>> left = coarsest_elements<D>(cube);
        while (!left.empty()) {
            Element<D> t = left.back();
            left.pop_back();
            if (t.level == 0) {
                continue;
            }
            for (const Element<D>& half : t.bisect()) {
                left.push_back(half);
            }
            const Int3 x = t.ref_node();
            if (std::max({x.x, x.y, x.z}) == 1) {
                for (Int3& v : t.v) {
                    v = v - x;
                }
                at_origin_[bits(x)].push_back(t);
            }
        }
    }

    /// Calls f(t) for the elements that are bisected at p, in a fixed order. They have no values.
    template <class F>
    void for_each(const Int3& p, const NodeInfo& node, const F& f) const {
        const Int3 odd{node.odd[0] ? 1 : 0, node.odd[1] ? 1 : 0, node.odd[2] ? 1 : 0};
        const Int3 end = lattice_.cells_at(node.level()) * (2 * node.scale);
        const unsigned even = 7U & ~bits(odd) & ~lattice_.flat_axes();
        for (unsigned sides = 0; sides < 8; ++sides) {
            if ((sides & ~even) != 0) {
                continue;
            }
            Int3 step;
            for (int axis = 0; axis < 3; ++axis) {
                const bool mirrored = odd[axis] != 0
                                          ? node.end0[axis] > p[axis]
                                          : (sides >> static_cast<unsigned>(axis) & 1U) != 0;
                step[axis] = mirrored ? -node.scale : node.scale;
            }
            for (Element<D> t : at_origin_[bits(odd)]) {
                t.level = node.level();
                for (Int3& v : t.v) {
                    v = p + Int3{v.x * step.x, v.y * step.y, v.z * step.z};
                }
                const auto [low, high] = t.bounds();
                if (min(low, {0, 0, 0}) == Int3{0, 0, 0} && max(high, end) == end) {
                    f(t);
                }
            }
        }
    }

  private:
    static unsigned bits(const Int3& odd) {
        return static_cast<unsigned>(odd.x + 2 * odd.y + 4 * odd.z);
    }

    const Lattice& lattice_;
    /// By the bits of the odd axes; vertices relative to the node.
    std::array<std::vector<Element<D>>, 8> at_origin_;
};

/// The linear function on an element, in coordinates of the lattice, and where the element is.
template <int D>
class CoarseFunction {
  public:
    CoarseFunction(const WholeLattice& whole, const Element<D>& t) : t_(t) {
        Simplex simplex;
        simplex.vertices = D + 1;
        simplex.flat = whole.lattice().flat_axes();
        for (std::size_t i = 0; i < t.v.size(); ++i) {
            simplex.v[i] = {static_cast<double>(t.v[i].x), static_cast<double>(t.v[i].y),
                            static_cast<double>(t.v[i].z)};
        }
        weights_ = simplex.gradient_weights();
        for (std::size_t i = 0; i < t.v.size(); ++i) {
            values_[i] = whole.exact(t.v[i]);
            for (std::size_t a = 0; a < 3; ++a) {
                gradient_[a] += weights_[i][a] * values_[i];
            }
        }
    }
    [[nodiscard]] const Element<D>& element() const { return t_; }
    [[nodiscard]] double value_at(std::size_t vertex) const { return values_[vertex]; }
    [[nodiscard]] bool is_complete() const {
        return std::all_of(values_.begin(), values_.end(),
                           [](double u) { return std::isfinite(u); });
    }
    [[nodiscard]] double operator()(const Int3& p) const {
        const Int3 d = p - t_.v[0];
        return values_[0] + gradient_[0] * static_cast<double>(d.x) +
               gradient_[1] * static_cast<double>(d.y) + gradient_[2] * static_cast<double>(d.z);
    }
    /// Whether it contains a finer element of the nested grid.
    [[nodiscard]] bool contains(const std::array<Int3, D + 1>& v) const {
        Double3 middle{};
        for (const Int3& p : v) {
            const Int3 d = p - t_.v[0];
            for (int a = 0; a < 3; ++a) {
                middle[static_cast<std::size_t>(a)] += static_cast<double>(d[a]) / (D + 1);
            }
        }
        for (std::size_t i = 0; i < v.size(); ++i) {
            if (!(dot(weights_[i], middle) + (i == 0 ? 1 : 0) > 0)) {
                return false;
            }
        }
        return true;
    }

  private:
    Element<D> t_;
    std::array<Double3, 4> weights_{};
    std::array<double, D + 1> values_{};
    Double3 gradient_{};
};

template <int D>
class Supports {
  public:
    Supports(const WholeLattice& whole, const ComputedField& field, const Double3& spacing,
             Progress& progress)
        : whole_(whole),
          field_(field),
          spacing_(spacing),
          progress_(progress),
          diamonds_(whole.lattice()),
          last_(whole.lattice().nodes() - Int3{1, 1, 1}),
          range_(range_of(whole)),
          search_(whole.lattice(), spacing, range_) {
        for (std::size_t axis = 0, k = 1; axis < 3; ++axis) {
            if (last_[static_cast<int>(axis)] > 0) {
                size_ *= spacing[axis] / static_cast<double>(k++);
            }
        }
    }

    [[nodiscard]] double measure(const Int3& p, const NodeInfo& node) const {
        std::vector<CoarseFunction<D>> coarse;
        bool complete = true;
        diamonds_.for_each(p, node, [&](const Element<D>& t) {
            coarse.emplace_back(whole_, t);
            complete = complete && coarse.back().is_complete();
        });
        if (!complete) {
            return kInfinity;
        }
        return field_.indicator == ComputedIndicator::deviation_graph ? graph_distance(coarse)
                                                                      : norm(coarse);
    }

  private:
    static double range_of(const WholeLattice& whole) {
        const Int3& n = whole.lattice().nodes();
        double low = kInfinity;
        double high = -kInfinity;
        for (std::int64_t i = 0; i < n.product(); ++i) {
            const double u = whole.exact(n.unlinear(i));
            if (std::isfinite(u)) {
                low = std::min(low, u);
                high = std::max(high, u);
            }
        }
        return high > low ? high - low : 1;
    }

    /// Calls f(finest) for the finest elements in t that are in the volume; their values are U -
    /// U^l. Returns false if a value is missing.
    template <class F>
    bool for_finest(const CoarseFunction<D>& coarse, const Element<D>& t, const F& f) const {
        constexpr int kCheckedLevel = 4;
        const Int3 low = t.bounds().first;
        for (int axis = 0; axis < 3; ++axis) {
            if (last_[axis] > 0 && low[axis] >= last_[axis]) {
                return true;
            }
        }
        if (t.level == 0) {
            f(t);
            return t.is_complete();
        }
        if (t.level == kCheckedLevel && t.is_whole()) {
            progress_.check();
        }
        const Int3 x = t.ref_node();
        for (const Element<D>& half : t.bisect(whole_.exact(x) - coarse(x))) {
            if (!for_finest(coarse, half, f)) {
                return false;
            }
        }
        return true;
    }

    [[nodiscard]] double norm(const std::vector<CoarseFunction<D>>& coarse) const {
        const bool of_gradient = field_.indicator == ComputedIndicator::deviation_grad_lp;
        const double power = field_.power;
        double sum = 0;
        double most = 0;
        for (const CoarseFunction<D>& function : coarse) {
            const bool complete =
                for_finest(function, function.element(), [&](const Element<D>& finest) {
                    if (of_gradient) {
                        const double slope = gradient_length(finest);
                        most = std::max(most, slope);
                        sum += std::isinf(power) ? 0 : size_ * std::pow(slope, power);
                    } else if (std::isinf(power)) {
                        for (const double e : finest.value) {
                            most = std::max(most, std::fabs(e));
                        }
                    } else if (finest.is_complete()) {
                        sum += size_ * mean_of_power(finest.value, power);
                    }
                });
            if (!complete) {
                return kInfinity;
            }
        }
        return std::isinf(power) ? most : std::pow(sum, 1 / power);
    }

    /// An element of the finest level walks along one axis after another.
    [[nodiscard]] double gradient_length(const Element<D>& finest) const {
        double sum = 0;
        for (std::size_t i = 0; i < D; ++i) {
            const Int3 step = finest.v[i + 1] - finest.v[i];
            const std::size_t axis = step.x != 0 ? 0 : step.y != 0 ? 1 : 2;
            const double slope = (finest.value[i + 1] - finest.value[i]) / spacing_[axis];
            sum += slope * slope;
        }
        return std::sqrt(sum);
    }

    [[nodiscard]] double graph_distance(const std::vector<CoarseFunction<D>>& coarse) const {
        std::vector<std::array<GraphPoint, D + 1>> elements;
        for (const CoarseFunction<D>& function : coarse) {
            std::array<GraphPoint, D + 1> vertices{};
            for (std::size_t i = 0; i < vertices.size(); ++i) {
                vertices[i] = search_.point(function.element().v[i], function.value_at(i));
            }
            elements.push_back(vertices);
        }
        const auto exact = [&](const Int3& q) { return whole_.exact(q); };
        const auto in_support = [&](const std::array<Int3, D + 1>& v) {
            return std::any_of(coarse.begin(), coarse.end(),
                               [&](const CoarseFunction<D>& t) { return t.contains(v); });
        };
        double most = 0;
        const auto try_node = [&](const CoarseFunction<D>& function, const Int3& q, double error) {
            // No point of a graph is further from the other graph.
            const double bound = std::fabs(error) / range_;
            if (!(bound > most)) {
                return;
            }
            const GraphPoint of_data = search_.point(q, whole_.exact(q));
            double nearest = bound;
            for (const std::array<GraphPoint, D + 1>& vertices : elements) {
                nearest = std::min(nearest, distance_to_simplex(of_data, vertices));
            }
            most = std::max(most, nearest);
            most =
                search_.distance(search_.point(q, function(q)), q, bound, most, exact, in_support);
        };
        for (const CoarseFunction<D>& function : coarse) {
            const bool complete =
                for_finest(function, function.element(), [&](const Element<D>& finest) {
                    for (std::size_t i = 0; i < finest.v.size(); ++i) {
                        try_node(function, finest.v[i], finest.value[i]);
                    }
                });
            if (!complete) {
                return kInfinity;
            }
        }
        return most;
    }

    const WholeLattice& whole_;
    ComputedField field_;
    Double3 spacing_;
    Progress& progress_;
    Diamonds<D> diamonds_;
    Int3 last_;
    double range_;
    GraphSearch<D> search_;
    double size_ = 1;  ///< of an element of the finest level
};

template <int D>
SupportMeasure measure_of(const WholeLattice& whole, const ComputedField& field,
                          const Double3& spacing, Progress& progress) {
    const auto supports = std::make_shared<Supports<D>>(whole, field, spacing, progress);
    return [supports](const Int3& p, const NodeInfo& node) { return supports->measure(p, node); };
}

}  // namespace

SupportMeasure measure_of_support(const WholeLattice& whole, const ComputedField& field,
                                  const Double3& spacing, Progress& progress) {
    switch (whole.lattice().dimension()) {
        case 0:  // no refinement nodes
            return [](const Int3&, const NodeInfo&) { return 0.0; };
        case 1:
            return measure_of<1>(whole, field, spacing, progress);
        case 2:
            return measure_of<2>(whole, field, spacing, progress);
        default:
            return measure_of<3>(whole, field, spacing, progress);
    }
}

}  // namespace isonest::detail
