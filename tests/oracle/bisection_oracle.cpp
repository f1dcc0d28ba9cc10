#include "tests/oracle/bisection_oracle.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace isonest::oracle {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Int3 macro_cubes(const Int3& nodes, int level) {
    const std::int64_t edge = std::int64_t{1} << level;
    return ceil_div(nodes - Int3{1, 1, 1}, {edge, edge, edge});
}

}  // namespace

BisectionOracle::BisectionOracle(const Int3& nodes, std::vector<double> values,
                                 std::optional<int> macro_level)
    : nodes_(nodes), values_(std::move(values)) {
    const auto too_small = [&](int level) {
        const Int3 cubes = macro_cubes(nodes, level);
        return std::max({cubes.x, cubes.y, cubes.z}) > 1;
    };
    while (!macro_level && too_small(macro_level_)) {
        ++macro_level_;
    }
    macro_level_ = macro_level.value_or(macro_level_);
    extent_ = macro_cubes(nodes, macro_level_) * (std::int64_t{1} << macro_level_) + Int3{1, 1, 1};
}

bool BisectionOracle::has_missing_vertex(const Simplex& t) const {
    return !std::all_of(t.v.begin(), t.v.end(),
                        [&](const Int3& p) { return std::isfinite(value(p)); });
}

bool BisectionOracle::exists(const Simplex& t) const {
    const Int3 low = t.low();
    return low.x < nodes_.x - 1 && low.y < nodes_.y - 1 && low.z < nodes_.z - 1;
}

std::vector<Simplex> BisectionOracle::roots() const {
    const Int3 cubes = macro_cubes(nodes_, macro_level_);
    std::vector<Simplex> all;
    for (std::int64_t i = 0; i < cubes.product(); ++i) {
        for (const Simplex& t :
             kuhn_simplices(cubes.unlinear(i), std::int64_t{1} << macro_level_)) {
            if (exists(t)) {
                all.push_back(t);
            }
        }
    }
    return all;
}

std::vector<Simplex> BisectionOracle::children(const Simplex& t) const {
    std::vector<Simplex> existing;
    for (const Simplex& child : t.bisect()) {
        if (child.tag != 3 || exists(child)) {
            existing.push_back(child);
        }
    }
    return existing;
}

void BisectionOracle::descend(const Simplex& t, int generations,
                              const std::function<void(const Simplex&)>& visit) const {
    if (generations == 0) {
        visit(t);
        return;
    }
    for (const Simplex& child : t.bisect()) {
        if (child.tag != 3 || exists(child)) {
            descend(child, generations - 1, visit);
        }
    }
}

void BisectionOracle::for_each(int generation,
                               const std::function<void(const Simplex&)>& visit) const {
    for (const Simplex& t : roots()) {
        descend(t, generation, visit);
    }
}

NodalField BisectionOracle::refinement_nodes() const {
    NodalField field(extent_);
    for (int g = 0; g + 1 < generations(); ++g) {
        for_each(g, [&](const Simplex& t) { field.at(t.refinement_node()) = 1; });
    }
    return field;
}

NodalField BisectionOracle::eta() const {
    NodalField field(extent_);
    for (int g = 0; g + 1 < generations(); ++g) {
        for_each(g, [&](const Simplex& t) {
            const Int3 x = t.refinement_node();
            const bool missing = !std::isfinite(value(x)) || has_missing_vertex(t);
            const double offset = value(x) - (value(t.end0()) / 2 + value(t.end1()) / 2);
            field.at(x) = std::max(field.at(x), missing ? kInfinity : std::fabs(offset));
        });
    }
    return field;
}

double BisectionOracle::deviation_of(const Simplex& t, DeviationPoints points) const {
    if (has_missing_vertex(t)) {
        return kInfinity;
    }
    const Barycentric weights = t.barycentric();
    const double scale = 1 / static_cast<double>(weights.total);  // a power of two: exact
    const Int3 lo = t.low();
    const Int3 hi =
        points == DeviationPoints::volume ? min(t.high(), nodes_ - Int3{1, 1, 1}) : t.high();
    double worst = 0;
    for (std::int64_t z = lo.z; z <= hi.z; ++z) {
        for (std::int64_t y = lo.y; y <= hi.y; ++y) {
            std::array<std::int64_t, 4> b = weights.at({lo.x, y, z});
            for (std::int64_t x = lo.x; x <= hi.x; ++x) {
                if (b[0] >= 0 && b[1] >= 0 && b[2] >= 0 && b[3] >= 0) {
                    double linear = 0;
                    for (std::size_t i = 0; i < 4; ++i) {
                        linear += static_cast<double>(b[i]) * scale * value(t.v[i]);
                    }
                    const double d = std::fabs(value({x, y, z}) - linear);
                    worst = std::isfinite(d) ? std::max(worst, d) : kInfinity;
                }
                for (std::size_t i = 0; i < 4; ++i) {
                    b[i] += weights.slope[i].x;
                }
            }
        }
    }
    return worst;
}

NodalField BisectionOracle::deviation(DeviationPoints points) const {
    NodalField field(extent_);
    for (int g = 0; g + 1 < generations(); ++g) {
        for_each(g, [&](const Simplex& t) {
            double& worst = field.at(t.refinement_node());
            worst = std::max(worst, deviation_of(t, points));
        });
    }
    return field;
}

NodalField BisectionOracle::saturated(const NodalField& field,
                                      double (*combine)(double own, double children)) const {
    NodalField out = field;
    NodalField largest(extent_);
    for (int g = generations() - 2; g >= 0; --g) {
        // All tetrahedra sharing a node contribute their children before the node is combined.
        for_each(g, [&](const Simplex& t) {
            for (const Simplex& child : children(t)) {
                if (!child.is_finest()) {
                    double& most = largest.at(t.refinement_node());
                    most = std::max(most, out.at(child.refinement_node()));
                }
            }
        });
        for_each(g, [&](const Simplex& t) {
            const Int3 x = t.refinement_node();
            out.at(x) = combine(field.at(x), largest.at(x));
        });
    }
    return out;
}

NodalField BisectionOracle::saturated_by_maximum(const NodalField& field) const {
    return saturated(field, [](double own, double children) { return std::max(own, children); });
}

NodalField BisectionOracle::saturated_by_sum(const NodalField& field) const {
    return saturated(field, [](double own, double children) { return own + children; });
}

}  // namespace isonest::oracle
