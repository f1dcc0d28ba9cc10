#include "tests/bisection_oracle.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace isonest::test {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

BisectionOracle::Key key_of(const Int3& p) {
    return {p.x, p.y, p.z};
}

}  // namespace

std::array<BisectionOracle::Element, 2> BisectionOracle::bisect(const Element& t) {
    const Int3 z = middle(t);
    const auto d = static_cast<std::size_t>(t.tag);
    Element a = t;
    Element b = t;
    a.v[d] = z;
    for (std::size_t i = 0; i < d; ++i) {
        b.v[i] = t.v[i + 1];
    }
    b.v[d] = z;
    a.tag = b.tag = t.tag == 1 ? 3 : t.tag - 1;
    return {a, b};
}

/// A tetrahedron exists if the cube it fills a sixth of begins inside the volume.
bool BisectionOracle::exists(const Element& t) const {
    Int3 low = t.v[0];
    for (const Int3& v : t.v) {
        low = min(low, v);
    }
    return low.x < n_.x - 1 && low.y < n_.y - 1 && low.z < n_.z - 1;
}

double BisectionOracle::deviation(const Element& t) const {
    // Barycentric coordinates from the inverse of the edge matrix, by Cramer's rule.
    const auto sub = [&](const Int3& p) {
        return std::array<double, 3>{static_cast<double>(p.x - t.v[0].x),
                                     static_cast<double>(p.y - t.v[0].y),
                                     static_cast<double>(p.z - t.v[0].z)};
    };
    const auto det = [](const std::array<double, 3>& a, const std::array<double, 3>& b,
                        const std::array<double, 3>& c) {
        return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) +
               a[2] * (b[0] * c[1] - b[1] * c[0]);
    };
    const auto e1 = sub(t.v[1]);
    const auto e2 = sub(t.v[2]);
    const auto e3 = sub(t.v[3]);
    const double volume = det(e1, e2, e3);
    Int3 lo = t.v[0];
    Int3 hi = t.v[0];
    for (const Int3& v : t.v) {
        lo = min(lo, v);
        hi = max(hi, v);
    }
    hi = min(hi, n_ - Int3{1, 1, 1});
    double worst = 0;
    for (std::int64_t z = lo.z; z <= hi.z; ++z) {
        for (std::int64_t y = lo.y; y <= hi.y; ++y) {
            for (std::int64_t x = lo.x; x <= hi.x; ++x) {
                const auto p = sub({x, y, z});
                const double b1 = det(p, e2, e3) / volume;
                const double b2 = det(e1, p, e3) / volume;
                const double b3 = det(e1, e2, p) / volume;
                const double b0 = 1 - b1 - b2 - b3;
                if (std::min({b0, b1, b2, b3}) < -1e-9) {
                    continue;
                }
                const double linear = b0 * value_(t.v[0]) + b1 * value_(t.v[1]) +
                                      b2 * value_(t.v[2]) + b3 * value_(t.v[3]);
                const double d = std::fabs(value_({x, y, z}) - linear);
                worst = std::isfinite(d) ? std::max(worst, d) : kInfinity;
            }
        }
    }
    return worst;
}

BisectionOracle::BisectionOracle(const Int3& n, const std::function<double(const Int3&)>& value)
    : n_(n), value_(value) {
    const int top = Lattice(n).top();
    const std::int64_t edge = std::int64_t{1} << top;
    std::vector<std::vector<Element>> generations(1);
    std::array<int, 3> axes{0, 1, 2};
    do {
        Element t{{}, 3};
        for (std::size_t i = 0; i < 3; ++i) {
            t.v[i + 1] = t.v[i];
            t.v[i + 1][axes[i]] += edge;
        }
        if (exists(t)) {
            generations[0].push_back(t);
        }
    } while (std::next_permutation(axes.begin(), axes.end()));
    for (int g = 0; g + 1 < 3 * top; ++g) {
        std::vector<Element> next;
        for (const Element& t : generations.back()) {
            for (const Element& child : bisect(t)) {
                if (child.tag != 3 || exists(child)) {
                    next.push_back(child);
                }
            }
        }
        generations.push_back(std::move(next));
    }
    if (top == 0) {
        return;
    }
    for (std::size_t g = generations.size(); g-- > 0;) {
        std::map<Key, std::array<double, 3>> children;  // largest bar, plus, deviation_bar
        for (const Element& t : generations[g]) {
            const Int3 x = middle(t);
            OracleNode& node = nodes_[key_of(x)];
            const double u =
                value_(x) - (value_(t.v[0]) + value_(t.v[static_cast<std::size_t>(t.tag)])) / 2;
            bool missing = !std::isfinite(value_(x));
            bool around = false;
            for (const Int3& v : t.v) {
                around = around || !std::isfinite(value_(v));
            }
            // At level 1 only the node and the ends of its refinement edge count.
            const bool finest = g + 3 >= generations.size();
            missing = finest ? !std::isfinite(u) : missing || around;
            node.eta = std::max(node.eta, missing ? kInfinity : std::fabs(u));
            node.deviation =
                std::max(node.deviation, finest && (missing || around) ? node.eta : deviation(t));
            auto& largest = children[key_of(x)];
            if (g + 1 < generations.size()) {
                for (const Element& child : bisect(t)) {
                    if (child.tag == 3 && !exists(child)) {
                        continue;
                    }
                    const OracleNode& c = nodes_.at(key_of(middle(child)));
                    largest[0] = std::max(largest[0], c.bar);
                    largest[1] = std::max(largest[1], c.plus);
                    largest[2] = std::max(largest[2], c.deviation_bar);
                }
            }
        }
        for (const auto& [key, largest] : children) {
            OracleNode& node = nodes_.at(key);
            node.bar = std::max(node.eta, largest[0]);
            node.plus = node.eta + largest[1];
            node.deviation_bar = std::max(node.deviation, largest[2]);
        }
    }
}

}  // namespace isonest::test
