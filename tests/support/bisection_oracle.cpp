#include "tests/support/bisection_oracle.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace isonest::detail::test {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

BisectionOracle::Key key_of(const Int3& p) {
    return {p.x, p.y, p.z};
}

double norm(const std::array<double, 3>& g) {
    return std::hypot(g[0], g[1], g[2]);
}

std::array<double, 3> difference(const std::array<double, 3>& a, const std::array<double, 3>& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

std::array<double, 3> unit(const std::array<double, 3>& g) {
    const double n = norm(g);
    // Gradients as small as rounding errors have no direction.
    return n > 1e-9 ? std::array<double, 3>{g[0] / n, g[1] / n, g[2] / n} : std::array<double, 3>{};
}

double& at(std::array<double, kIndicatorCount>& values, Indicator indicator) {
    return values[static_cast<std::size_t>(indicator)];
}

}  // namespace

Int3 BisectionOracle::middle(const Element& t) const {
    const Int3 sum = t.v[0] + t.v[static_cast<std::size_t>(t.tag)];
    return {sum.x / 2, sum.y / 2, sum.z / 2};
}

std::array<BisectionOracle::Element, 2> BisectionOracle::bisect(const Element& t) const {
    const Int3 z = middle(t);
    const auto k = static_cast<std::size_t>(t.tag);
    Element a = t;
    Element b = t;
    a.v[k] = z;
    for (std::size_t i = 0; i < k; ++i) {
        b.v[i] = t.v[i + 1];
    }
    b.v[k] = z;
    a.tag = b.tag = t.tag == 1 ? static_cast<int>(d_) : t.tag - 1;
    return {a, b};
}

/// An element exists if the cube that contains it begins inside the volume.
bool BisectionOracle::exists(const Element& t) const {
    Int3 low = t.v[0];
    for (std::size_t i = 0; i <= d_; ++i) {
        low = min(low, t.v[i]);
    }
    return std::all_of(axes_.begin(), axes_.end(),
                       [&](int axis) { return low[axis] < n_[axis] - 1; });
}

/// The edges from vertex 0 as rows, in world units; rows of flat axes are those of the identity.
std::array<BisectionOracle::Gradient, 3> BisectionOracle::edges(const Element& t) const {
    std::array<Gradient, 3> rows{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    for (std::size_t i = 0; i < d_; ++i) {
        rows[static_cast<std::size_t>(axes_[i])] = {};
        for (const int axis : axes_) {
            const auto a = static_cast<std::size_t>(axis);
            rows[static_cast<std::size_t>(axes_[i])][a] =
                static_cast<double>(t.v[i + 1][axis] - t.v[0][axis]) * spacing_[a];
        }
    }
    return rows;
}

double BisectionOracle::determinant(const std::array<Gradient, 3>& r) const {
    return r[0][0] * (r[1][1] * r[2][2] - r[1][2] * r[2][1]) -
           r[0][1] * (r[1][0] * r[2][2] - r[1][2] * r[2][0]) +
           r[0][2] * (r[1][0] * r[2][1] - r[1][1] * r[2][0]);
}

double BisectionOracle::measure(const Element& t) const {
    constexpr std::array<double, 4> kFactorial{1, 1, 2, 6};
    return std::fabs(determinant(edges(t))) / kFactorial[d_];
}

/// By Cramer's rule: one of the edge rows is replaced.
std::array<double, 4> BisectionOracle::barycentric(const Element& t, const Gradient& p) const {
    const auto rows = edges(t);
    const double volume = determinant(rows);
    std::array<double, 4> weights{1, 0, 0, 0};
    Gradient from{};
    for (const int axis : axes_) {
        const auto a = static_cast<std::size_t>(axis);
        from[a] = (p[a] - static_cast<double>(t.v[0][axis])) * spacing_[a];
    }
    for (std::size_t i = 0; i < d_; ++i) {
        auto replaced = rows;
        replaced[static_cast<std::size_t>(axes_[i])] = from;
        weights[i + 1] = determinant(replaced) / volume;
        weights[0] -= weights[i + 1];
    }
    return weights;
}

/// By differences of the linear function at points one unit apart.
BisectionOracle::Gradient BisectionOracle::gradient(const Element& t,
                                                    const std::array<double, 4>& u) const {
    Gradient g{};
    const Gradient origin{};
    const auto w0 = barycentric(t, origin);
    for (const int axis : axes_) {
        const auto a = static_cast<std::size_t>(axis);
        Gradient step{};
        step[a] = 1;
        const auto w1 = barycentric(t, step);
        for (std::size_t i = 1; i <= d_; ++i) {
            g[a] += (w1[i] - w0[i]) * (u[i] - u[0]) / spacing_[a];
        }
    }
    return g;
}

/// From the face's vertices: the midpoint, and the vertices of t that are not on the refinement
/// edge.
BisectionOracle::Gradient BisectionOracle::normal_between_children(const Element& t) const {
    const Int3 x = middle(t);
    std::vector<Gradient> along;  // d - 1 directions in the face, then the flat axes
    for (std::size_t i = 1; i <= d_; ++i) {
        if (i != static_cast<std::size_t>(t.tag)) {
            const Int3 e = t.v[i] - x;
            along.push_back({static_cast<double>(e.x) * spacing_[0],
                             static_cast<double>(e.y) * spacing_[1],
                             static_cast<double>(e.z) * spacing_[2]});
        }
    }
    for (std::size_t a = 0; a < 3; ++a) {
        if (n_[static_cast<int>(a)] == 1) {
            Gradient axis{};
            axis[a] = 1;
            along.push_back(axis);
        }
    }
    const Gradient& a = along.at(0);
    const Gradient& b = along.at(1);
    return unit({a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]});
}

double BisectionOracle::deviation(const Element& t) const {
    Int3 lo = t.v[0];
    Int3 hi = t.v[0];
    for (std::size_t i = 0; i <= d_; ++i) {
        lo = min(lo, t.v[i]);
        hi = max(hi, t.v[i]);
    }
    hi = min(hi, n_ - Int3{1, 1, 1});
    double worst = 0;
    for (std::int64_t i = 0; i < (hi - lo + Int3{1, 1, 1}).product(); ++i) {
        const Int3 p = lo + (hi - lo + Int3{1, 1, 1}).unlinear(i);
        const auto w = barycentric(
            t, {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)});
        double linear = 0;
        double least = 0;
        for (std::size_t v = 0; v <= d_; ++v) {
            least = std::min(least, w[v]);
            linear += w[v] * value_(t.v[v]);
        }
        if (least < -1e-9) {
            continue;
        }
        const double difference = std::fabs(value_(p) - linear);
        worst = std::isfinite(difference) ? std::max(worst, difference) : kInfinity;
    }
    return worst;
}

BisectionOracle::BisectionOracle(const Int3& n, std::function<double(const Int3&)> value,
                                 const Double3& spacing, const OwnMeasure& own_measure)
    : n_(n), value_(std::move(value)), spacing_(spacing) {
    for (int axis = 0; axis < 3; ++axis) {
        if (n[axis] > 1) {
            axes_.push_back(axis);
        }
    }
    d_ = axes_.size();
    const int top = Lattice(n).top();
    const std::int64_t edge = std::int64_t{1} << top;
    std::vector<std::vector<Element>> generations(1);
    std::vector<int> order = axes_;
    do {
        Element t{{}, static_cast<int>(d_)};
        for (std::size_t i = 0; i < d_; ++i) {
            t.v[i + 1] = t.v[i];
            t.v[i + 1][order[i]] += edge;
        }
        if (exists(t)) {
            generations[0].push_back(t);
        }
    } while (std::next_permutation(order.begin(), order.end()));
    if (top == 0) {
        return;
    }
    const int whole = static_cast<int>(d_);
    for (int g = 0; g + 1 < whole * top; ++g) {
        std::vector<Element> next;
        for (const Element& t : generations.back()) {
            for (const Element& child : bisect(t)) {
                if (child.tag != whole || exists(child)) {
                    next.push_back(child);
                }
            }
        }
        generations.push_back(std::move(next));
    }
    for (std::size_t g = generations.size(); g-- > 0;) {
        const bool finest = g + d_ >= generations.size();
        std::map<Key, OracleNode> children;  // the maximums of bar and plus
        std::map<Key, double> size;
        for (const Element& t : generations[g]) {
            const Int3 x = middle(t);
            OracleNode& node = nodes_[key_of(x)];
            const auto tag = static_cast<std::size_t>(t.tag);
            const double u = std::fabs(value_(x) - (value_(t.v[0]) + value_(t.v[tag])) / 2);
            bool around = !std::isfinite(value_(x));
            std::array<double, 4> at_vertices{};
            for (std::size_t i = 0; i <= d_; ++i) {
                at_vertices[i] = value_(t.v[i]);
                around = around || !std::isfinite(at_vertices[i]);
            }
            // At level 1 only the node and the ends of its refinement edge count.
            const double eta = (finest ? !std::isfinite(u) : around) ? kInfinity : u;
            using enum Indicator;
            auto& own = node.eta;
            at(own, linf) = std::max(at(own, linf), eta);
            at(own, Indicator::deviation) = std::max(
                at(own, Indicator::deviation),
                finest && (around || !std::isfinite(u)) ? at(own, linf) : this->deviation(t));
            if (own_measure) {
                const double m = around ? kInfinity : own_measure(std::span(t.v).first(d_ + 1), x);
                node.own_eta = std::max(node.own_eta, m);
            }
            const double volume = measure(t);
            size[key_of(x)] += volume;
            const double total = size[key_of(x)];
            at(own, l1) = at(own, linf) * total / static_cast<double>(d_ + 1);
            at(own, l2) = at(own, linf) * std::sqrt(total) / static_cast<double>(d_ + 1);
            const Int3 along = t.v[tag] - t.v[0];
            const double h = norm({static_cast<double>(along.x) * spacing_[0],
                                   static_cast<double>(along.y) * spacing_[1],
                                   static_cast<double>(along.z) * spacing_[2]});
            at(own, grad_edge) = 2 * at(own, linf) / h;
            std::array<Gradient, 2> n_child{};
            double mean = 0;
            const auto halves = bisect(t);
            double grad2 = at(own, grad_l2) * at(own, grad_l2);
            for (std::size_t c = 0; c < 2; ++c) {
                std::array<double, 4> hat{};
                std::array<double, 4> at_child{};
                for (std::size_t i = 0; i <= d_; ++i) {
                    const bool is_node = halves[c].v[i] == x;
                    hat[i] = is_node ? 1 : 0;
                    at_child[i] = value_(halves[c].v[i]);
                }
                const double g_hat = norm(gradient(halves[c], hat)) * eta;
                at(own, grad_linf) = std::max(at(own, grad_linf), g_hat);
                at(own, grad_l1) += g_hat * volume / 2;
                grad2 += g_hat * g_hat * volume / 2;
                const Gradient g_child = gradient(halves[c], at_child);
                mean += norm(g_child) / 2;
                n_child[c] = unit(g_child);
            }
            at(own, grad_l2) = std::sqrt(grad2);
            const Gradient n_whole = unit(gradient(t, at_vertices));
            const auto raise = [&](Indicator which, double by) {
                at(own, which) = std::max(at(own, which), around ? kInfinity : by);
            };
            raise(normal_jump, norm(difference(n_child[0], n_child[1])));
            const Gradient jump = difference(n_child[0], n_child[1]);
            const Gradient across = normal_between_children(t);
            raise(normal,
                  std::fabs(jump[0] * across[0] + jump[1] * across[1] + jump[2] * across[2]));
            raise(normal_edge, mean > 1e-9 ? 4 * u / h / mean : 0);
            raise(normal_turn, std::max(norm(difference(n_child[0], n_whole)),
                                        norm(difference(n_child[1], n_whole))));
            OracleNode& largest = children[key_of(x)];
            if (g + 1 == generations.size()) {
                continue;
            }
            for (const Element& child : halves) {
                if (child.tag == whole && !exists(child)) {
                    continue;
                }
                const OracleNode& c = nodes_.at(key_of(middle(child)));
                largest.own_bar = std::max(largest.own_bar, c.own_bar);
                largest.own_plus = std::max(largest.own_plus, c.own_plus);
                for (std::size_t i = 0; i < kIndicatorCount; ++i) {
                    largest.bar[i] = std::max(largest.bar[i], c.bar[i]);
                    largest.plus[i] = std::max(largest.plus[i], c.plus[i]);
                }
            }
        }
        for (const auto& [key, largest] : children) {
            OracleNode& node = nodes_.at(key);
            node.own_bar = std::max(node.own_eta, largest.own_bar);
            node.own_plus = node.own_eta + largest.own_plus;
            for (std::size_t i = 0; i < kIndicatorCount; ++i) {
                node.bar[i] = std::max(node.eta[i], largest.bar[i]);
                node.plus[i] = node.eta[i] + largest.plus[i];
            }
            // At level 1 the sum of deviations starts with eta_infinity.
            if (finest) {
                node.plus[static_cast<std::size_t>(Indicator::deviation)] =
                    node.plus[static_cast<std::size_t>(Indicator::linf)];
            }
        }
    }
}

}  // namespace isonest::detail::test
