// eta* over the supports of nodes, compared with all finest elements in all elements that explicit
// bisection makes around each node.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <tuple>
#include <vector>

#include "query/study/computed_field.h"
#include "query/study/graph_distance.h"
#include "query/study/study.h"
#include "query/traverse/adapt_traverse.h"
#include "store/base/vectors.h"
#include "store/lattice/simplex.h"
#include "tests/support/loaded_lattice.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr Double3 kSpacing{1, 0.5, 2};
constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Loaded : LoadedLattice {
    Loaded(const Int3& n, const std::function<double(const Int3&)>& f)
        : LoadedLattice(n, f, kSpacing, with_chunk(8, true)) {}
};

ComputedField field_named(const std::string& name) {
    const std::optional<ComputedField> field = computed_field_from_name(name);
    REQUIRE(field);
    return *field;
}

/// An element in world coordinates with a linear function.
struct Piece {
    Simplex simplex;
    std::array<double, 4> value{};
    std::array<Int3, 4> node{};

    [[nodiscard]] double at(const Double3& p) const {
        const std::array<Double3, 4> weights = simplex.gradient_weights();
        double u = value[0];
        for (int i = 0; i < simplex.vertices; ++i) {
            u += value[static_cast<std::size_t>(i)] *
                 dot(weights[static_cast<std::size_t>(i)], difference(p, simplex.v[0]));
        }
        return u;
    }
    [[nodiscard]] Double3 gradient() const {
        const std::array<Double3, 4> weights = simplex.gradient_weights();
        Double3 g{};
        for (std::size_t i = 0; i < 4; ++i) {
            for (std::size_t a = 0; a < 3; ++a) {
                g[a] += value[i] * weights[i][a];
            }
        }
        return g;
    }
    static Double3 difference(const Double3& a, const Double3& b) {
        return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    }
    [[nodiscard]] Double3 middle() const {
        Double3 m{};
        for (int i = 0; i < simplex.vertices; ++i) {
            for (std::size_t a = 0; a < 3; ++a) {
                m[a] += simplex.v[static_cast<std::size_t>(i)][a] / simplex.vertices;
            }
        }
        return m;
    }
    [[nodiscard]] bool contains(const Double3& p) const {
        const std::array<Double3, 4> weights = simplex.gradient_weights();
        for (int i = 0; i < simplex.vertices; ++i) {
            const double w = dot(weights[static_cast<std::size_t>(i)], difference(p, simplex.v[0]));
            if (w + (i == 0 ? 1 : 0) < 1e-9) {
                return false;
            }
        }
        return true;
    }
};

struct Key {
    bool operator()(const Int3& a, const Int3& b) const {
        return std::tie(a.z, a.y, a.x) < std::tie(b.z, b.y, b.x);
    }
};

/// The coarse elements around each node, and the finest ones in the volume.
template <int D>
struct Bisected {
    explicit Bisected(const Loaded& l) {
        const Lattice& lattice = l.whole->lattice();
        const Int3 last = lattice.nodes() - Int3{1, 1, 1};
        std::vector<Element<D>> left = coarsest_elements<D>(lattice);
        while (!left.empty()) {
            const Element<D> t = left.back();
            left.pop_back();
            const auto high = t.bounds().second;
            if (t.level == 0) {
                if (max(high, last) == last) {
                    finest.push_back(piece(l, t));
                }
                continue;
            }
            const Int3 end = lattice.cells_at(t.level) * (std::int64_t{1} << t.level);
            if (max(high, end) == end) {
                around[t.ref_node()].push_back(piece(l, t));
            }
            for (const Element<D>& half : t.bisect()) {
                left.push_back(half);
            }
        }
    }
    static Piece piece(const Loaded& l, const Element<D>& t) {
        Piece p;
        p.simplex.vertices = D + 1;
        p.simplex.flat = l.whole->lattice().flat_axes();
        for (std::size_t i = 0; i < t.v.size(); ++i) {
            p.node[i] = t.v[i];
            p.value[i] = l.volume.at(t.v[i]);
            for (std::size_t a = 0; a < 3; ++a) {
                p.simplex.v[i][a] = static_cast<double>(t.v[i][static_cast<int>(a)]) * kSpacing[a];
            }
        }
        return p;
    }
    std::map<Int3, std::vector<Piece>, Key> around;
    std::vector<Piece> finest;
};

/// The mean of |x|^power over a simplex with these values at its vertices, by many points.
double sampled_mean(const std::vector<double>& values, double power) {
    constexpr int kParts = 24;
    double sum = 0;
    int points = 0;
    std::array<int, 4> at{};
    const std::size_t n = values.size();
    // The points with barycentric coordinates (i + 1 / n) / (kParts + 1) that sum to 1.
    const std::function<void(std::size_t, int)> choose = [&](std::size_t i, int rest) {
        if (i + 1 == n) {
            at.at(i) = rest;
            double x = 0;
            for (std::size_t k = 0; k < n; ++k) {
                x += values[k] * (at.at(k) + 1.0 / static_cast<double>(n)) / (kParts + 1);
            }
            sum += std::pow(std::fabs(x), power);
            ++points;
            return;
        }
        for (int c = 0; c <= rest; ++c) {
            at.at(i) = c;
            choose(i + 1, rest - c);
        }
    };
    choose(0, kParts);
    return sum / points;
}

struct Wanted {
    double lp1 = 0;
    double lp2 = 0;
    double lp3 = 0;
    double linf = 0;
    double grad1 = 0;
    double grad2 = 0;
    double grad_inf = 0;
    double graph = 0;
};

GraphPoint graph_point(const Loaded& l, const Double3& at, double value) {
    double longest = 0;
    for (std::size_t a = 0; a < 3; ++a) {
        longest = std::max(
            longest, kSpacing[a] * static_cast<double>(l.volume.nodes()[static_cast<int>(a)] - 1));
    }
    return {at[0] / longest, at[1] / longest, at[2] / longest, value / l.range()};
}

double distance_to(const Loaded& l, const GraphPoint& p, const std::vector<Piece>& graph) {
    double best = kInfinity;
    for (const Piece& piece : graph) {
        std::array<GraphPoint, 4> vertices{};
        const auto count = static_cast<std::size_t>(piece.simplex.vertices);
        for (std::size_t i = 0; i < count; ++i) {
            vertices[i] = graph_point(l, piece.simplex.v[i], piece.value[i]);
        }
        best = std::min(best, distance_to_simplex(p, std::span(vertices.data(), count)));
    }
    return best;
}

template <int D>
Wanted wanted_at(const Loaded& l, const Bisected<D>& bisected, const std::vector<Piece>& around,
                 bool graphs) {
    Wanted w;
    std::vector<Piece> inside;
    std::vector<std::pair<GraphPoint, GraphPoint>> points;  // of U and of U^l
    for (const Piece& t : around) {
        for (const Piece& finest : bisected.finest) {
            if (!t.contains(finest.middle())) {
                continue;
            }
            inside.push_back(finest);
            std::vector<double> e;
            double sum = 0;
            double squares = 0;
            for (std::size_t i = 0; i <= D; ++i) {
                const double coarse = t.at(finest.simplex.v[i]);
                e.push_back(finest.value[i] - coarse);
                sum += e.back();
                squares += e.back() * e.back();
                w.linf = std::max(w.linf, std::fabs(e.back()));
                points.emplace_back(graph_point(l, finest.simplex.v[i], finest.value[i]),
                                    graph_point(l, finest.simplex.v[i], coarse));
            }
            const double size = finest.simplex.measure();
            const double slope = length(Piece::difference(finest.gradient(), t.gradient()));
            w.lp1 += size * sampled_mean(e, 1);
            w.lp2 += size * (squares + sum * sum) / ((D + 1) * (D + 2));
            w.lp3 += size * sampled_mean(e, 3);
            w.grad1 += size * slope;
            w.grad2 += size * slope * slope;
            w.grad_inf = std::max(w.grad_inf, slope);
        }
    }
    w.lp2 = std::sqrt(w.lp2);
    w.lp3 = std::cbrt(w.lp3);
    w.grad2 = std::sqrt(w.grad2);
    for (std::size_t i = 0; graphs && i < points.size(); ++i) {
        w.graph = std::max({w.graph, distance_to(l, points[i].first, around),
                            distance_to(l, points[i].second, inside)});
    }
    return w;
}

template <int D>
void compare(const Int3& n, bool graphs) {
    CAPTURE(n.x, n.y, n.z);
    Loaded l(n, [](const Int3& p) { return smooth(p) + 0.3 * noise(p); });
    const Bisected<D> bisected(l);
    std::map<Int3, Wanted, Key> wanted;
    for (const auto& [x, around] : bisected.around) {
        wanted.emplace(x, wanted_at(l, bisected, around, graphs));
    }
    REQUIRE(wanted.size() > 3);
    const std::vector<std::tuple<const char*, double Wanted::*, double>> cases{
        {"deviation_lp:1", &Wanted::lp1, 0.03},
        {"deviation_lp:2", &Wanted::lp2, 1e-5},
        {"deviation_lp:3", &Wanted::lp3, 0.03},
        {"deviation_lp:inf", &Wanted::linf, 1e-5},
        {"deviation_grad_lp:1", &Wanted::grad1, 1e-5},
        {"deviation_grad_lp:2", &Wanted::grad2, 1e-5},
        {"deviation_grad_lp:inf", &Wanted::grad_inf, 1e-5},
        {"deviation_graph", &Wanted::graph, 1e-5}};
    for (const auto& [name, member, accuracy] : cases) {
        if (name == std::string("deviation_graph") && !graphs) {
            continue;
        }
        CAPTURE(name);
        const double largest =
            compute_indicator(*l.whole, field_named(name), kSpacing, silent_progress());
        double most = 0;
        int wrong = 0;
        for (const auto& [x, w] : wanted) {
            const auto found = static_cast<double>(l.whole->indicator(x));
            wrong += found == Approx(w.*member).epsilon(accuracy).margin(1e-7) ? 0 : 1;
            most = std::max(most, found);
        }
        CHECK(wrong == 0);
        CHECK(largest == most);
        CHECK(most > 0);
    }
}

}  // namespace

TEST_CASE("eta* of a node is the norm over all finest elements in its support") {
    compare<3>({5, 5, 5}, true);
    compare<3>({6, 5, 4}, false);
    compare<2>({9, 9, 1}, true);
    compare<2>({1, 7, 12}, true);
    compare<1>({1, 13, 1}, true);
}

TEST_CASE("eta* in L infinity is the stored deviation where that is exact, and not above it") {
    const Int3 n{17, 17, 17};
    Loaded l(n, [](const Int3& p) { return smooth(p) + 0.2 * noise(p); });
    WholeLattice stored(l.store->layout());
    ChunkCache& cache = *l.cache;
    stored.load_values(cache);
    stored.load_indicator(cache, Field::deviation_bar, silent_progress());
    compute_indicator(*l.whole, field_named("deviation_lp:inf_bar"), kSpacing, silent_progress());
    int equal = 0;
    double ratio = 0;
    int nodes = 0;
    for (std::int64_t i = 0; i < n.product(); ++i) {
        const Int3 p = n.unlinear(i);
        const NodeInfo node = describe_node(p, l.whole->lattice().top());
        if (node.scale == 0) {
            continue;
        }
        const auto a = static_cast<double>(l.whole->indicator(p));
        const auto b = static_cast<double>(stored.indicator(p));
        REQUIRE(a <= b * (1 + 1e-6));
        ratio += a > 0 ? b / a : 1;
        ++nodes;
        if (node.level() <= 2) {
            REQUIRE(a == Approx(b).epsilon(1e-5).margin(1e-7));
            ++equal;
        }
    }
    CHECK(equal > 4000);
    CHECK(ratio / nodes < 1.05);
}

TEST_CASE("eta* is infinite where a value in the support is missing, and only there") {
    const Int3 missing{3, 4, 5};
    Loaded l({9, 9, 9}, [&](const Int3& p) {
        return p == missing ? std::numeric_limits<double>::quiet_NaN() : smooth(p);
    });
    const Bisected<3> bisected(l);
    for (const char* const name : {"deviation_lp:2", "deviation_grad_lp:inf", "deviation_graph"}) {
        compute_indicator(*l.whole, field_named(name), kSpacing, silent_progress());
        for (const auto& [x, around] : bisected.around) {
            bool touches = false;
            for (const Piece& t : around) {
                for (const Piece& finest : bisected.finest) {
                    touches = touches || (std::find(finest.node.begin(), finest.node.end(),
                                                    missing) != finest.node.end() &&
                                          t.contains(finest.middle()));
                }
            }
            REQUIRE(std::isinf(l.whole->indicator(x)) == touches);
        }
    }
}

TEST_CASE("the curvature of a graph is that of spheres and cylinders") {
    constexpr double kRadius = 70;
    for (const Int3& n : {Int3{33, 33, 1}, Int3{33, 1, 1}, Int3{17, 17, 17}}) {
        for (const bool cylinder : {false, true}) {
            const auto graph = [&](const Int3& p) {
                double square = kRadius * kRadius;
                for (int axis = 0; axis < (cylinder ? 1 : 3); ++axis) {
                    const double x =
                        static_cast<double>(p[axis]) * kSpacing[static_cast<std::size_t>(axis)];
                    square -= n[axis] > 1 ? x * x : 0;
                }
                return std::sqrt(square);
            };
            Loaded l(n, graph);
            const int curved = cylinder ? 1 : l.whole->lattice().dimension();
            compute_indicator(*l.whole, field_named("graph_curvature"), kSpacing,
                              silent_progress());
            int compared = 0;
            for (std::int64_t i = 0; i < n.product(); ++i) {
                const Int3 p = n.unlinear(i);
                bool inside = describe_node(p, l.whole->lattice().top()).scale > 0;
                for (int axis = 0; axis < 3; ++axis) {
                    inside = inside && (n[axis] == 1 || (p[axis] > 0 && p[axis] < n[axis] - 1));
                }
                if (inside) {
                    CHECK(static_cast<double>(l.whole->indicator(p)) ==
                          Approx(std::sqrt(curved) / kRadius).epsilon(0.02));
                    ++compared;
                }
            }
            CHECK(compared > 20);
        }
    }
}

TEST_CASE("a study of eta* refines down to the error in its norm") {
    Loaded l({17, 17, 1}, [](const Int3& p) { return smooth(p); });
    StudyOptions options;
    options.fields = {field_named("deviation_lp:2_bar"), field_named("deviation_graph_plus")};
    options.steps = 4;
    const Study s = study(*l.store, options, silent_progress());
    REQUIRE(s.rows.size() == 8);
    CHECK(name_of(s.rows[0].field) == "deviation_lp:2_bar");
    CHECK(s.rows[3].norms.l2 < s.rows[0].norms.l2);
    CHECK(s.rows[3].leaves > s.rows[0].leaves);
    CHECK(s.rows[7].leaves > s.rows[4].leaves);
}
