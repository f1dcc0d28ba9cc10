// The bounds of section 5 of the paper on every tetrahedron of a nested grid: which hold, and how
// often the others are exceeded.
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <vector>

#include "store/base/vectors.h"
#include "store/lattice/simplex.h"
#include "tests/support/bisection_oracle.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// How many tetrahedra exceed a bound somewhere.
struct Exceeded {
    std::size_t elements = 0;
    std::size_t half_of_plus = 0;   ///< the paper's beta_0 of the offset type, by |U - U_T|
    std::size_t half_of_range = 0;  ///< the same, by the values: min U_T - beta_0, max U_T + beta_0
    std::size_t plus = 0;           ///< the same without the factor 1/2
    std::size_t gradient_type = 0;  ///< beta_0 of the gradient type: h(T), the diameter, times it
    std::size_t beta_1 = 0;         ///< of the gradient
    std::size_t beta_n = 0;         ///< of the normal, from eta_N
    std::size_t turn = 0;           ///< of the normal, from normal_turn
};

/// Compares U_T on every tetrahedron T above the finest level with all nodes and all finest
/// tetrahedra in T.
class EveryTetrahedron {
  public:
    EveryTetrahedron(std::int64_t n, const std::function<double(const Int3&)>& u)
        : n_(n), u_(u), oracle_({n, n, n}, u) {}

    Exceeded run() {
        for (int order = 0; order < 6; ++order) {
            static_cast<void>(visit(kuhn_tetrahedron({0, 0, 0}, n_ - 1, order)));
        }
        return exceeded_;
    }

  private:
    struct Below {
        std::vector<Int3> nodes;  ///< may occur several times
        std::vector<Double3> gradients;
    };

    [[nodiscard]] static Simplex simplex_of(const Tetrahedron& t) {
        Simplex s;
        for (std::size_t i = 0; i < 4; ++i) {
            s.v[i] = {static_cast<double>(t.v[i].x), static_cast<double>(t.v[i].y),
                      static_cast<double>(t.v[i].z)};
        }
        return s;
    }
    [[nodiscard]] Double3 gradient(const Tetrahedron& t) const {
        const auto weights = simplex_of(t).gradient_weights();
        Double3 g{};
        for (std::size_t i = 0; i < 4; ++i) {
            for (std::size_t a = 0; a < 3; ++a) {
                g[a] += weights[i][a] * u_(t.v[i]);
            }
        }
        return g;
    }
    static Double3 minus(const Double3& a, const Double3& b) {
        return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    }
    static Double3 unit(const Double3& a) {
        const double size = length(a);
        return {a[0] / size, a[1] / size, a[2] / size};
    }

    Below visit(const Tetrahedron& t) {
        const Double3 g = gradient(t);
        double diameter = 0;
        for (std::size_t i = 0; i < 4; ++i) {
            for (std::size_t j = 0; j < i; ++j) {
                const Int3 d = t.v[i] - t.v[j];
                diameter = std::max(
                    diameter, std::sqrt(static_cast<double>(d.x * d.x + d.y * d.y + d.z * d.z)));
            }
        }
        if (diameter < 1.8 && t.kind == 0) {
            return {{t.v.begin(), t.v.end()}, {g}};
        }
        Below below;
        for (const Tetrahedron& child : t.bisect()) {
            const Below of_child = visit(child);
            below.nodes.insert(below.nodes.end(), of_child.nodes.begin(), of_child.nodes.end());
            below.gradients.insert(below.gradients.end(), of_child.gradients.begin(),
                                   of_child.gradients.end());
        }
        double offset = 0;
        double least = u_(t.v[0]);
        double most = least;
        for (const Int3& v : t.v) {
            least = std::min(least, u_(v));
            most = std::max(most, u_(v));
        }
        double beyond = 0;
        for (const Int3& p : below.nodes) {
            const Int3 from = p - t.v[0];
            const double u = u_(p);
            const double linear = u_(t.v[0]) + g[0] * static_cast<double>(from.x) +
                                  g[1] * static_cast<double>(from.y) +
                                  g[2] * static_cast<double>(from.z);
            offset = std::max(offset, std::fabs(u - linear));
            beyond = std::max({beyond, least - u, u - most});
        }
        double change = 0;
        double turn = 0;
        for (const Double3& finest : below.gradients) {
            change = std::max(change, length(minus(finest, g)));
            turn = std::max(turn, length(minus(unit(finest), unit(g))));
        }
        const Int3 x = t.ref_node();
        const OracleNode& node = oracle_.nodes().at({x.x, x.y, x.z});
        // Rounding is far smaller than what the data change.
        const auto count = [](std::size_t& counter, double value, double bound) {
            counter += value > bound + 1e-9 ? 1 : 0;
        };
        ++exceeded_.elements;
        const double plus = node.of(Field::linf_plus);
        const double gradient_plus = node.of(Field::grad_linf_plus);
        count(exceeded_.half_of_plus, offset, plus / 2);
        count(exceeded_.half_of_range, beyond, plus / 2);
        count(exceeded_.plus, offset, plus);
        count(exceeded_.gradient_type, offset, diameter * gradient_plus);
        count(exceeded_.beta_1, change, gradient_plus);
        count(exceeded_.beta_n, turn, node.of(Field::normal_plus));
        count(exceeded_.turn, turn, node.of(Field::normal_turn_plus));
        return below;
    }

    std::int64_t n_;
    std::function<double(const Int3&)> u_;
    BisectionOracle oracle_;
    Exceeded exceeded_;
};

}  // namespace

TEST_CASE("of the paper's bounds, half of eta_plus and the sum of eta_N are exceeded") {
    const auto smooth_data = [](const Int3& p) { return smooth(p); };
    const auto rough_data = [](const Int3& p) { return noise(p); };
    for (const bool rough : {false, true}) {
        CAPTURE(rough);
        const Exceeded e = rough ? EveryTetrahedron(33, rough_data).run()
                                 : EveryTetrahedron(33, smooth_data).run();
        REQUIRE(e.elements == 6 * 32767);
        const auto share = [&](std::size_t count) {
            return 100 * static_cast<double>(count) / static_cast<double>(e.elements);
        };
        CHECK(e.plus == 0);
        CHECK(e.gradient_type == 0);
        CHECK(e.beta_1 == 0);
        CHECK(e.turn == 0);
        // METHOD.md quotes these.
        CHECK(share(e.half_of_range) == Approx(rough ? 4.9 : 0.9).margin(0.1));
        CHECK(share(e.half_of_plus) == Approx(rough ? 59 : 75).margin(0.5));
        CHECK(share(e.beta_n) == Approx(rough ? 10 : 26).margin(0.5));
    }
}

TEST_CASE("the midpoint can turn the normals of both halves the same way") {
    // The diagonal from (0, 0) to (2, 2) is bisected. The gradient is (1, 1), and (1, 1.3) and
    // (0.7, 1) in the halves: the normals turn by 0.13 and 0.17, but hardly differ across the face
    // between the halves. All other offsets are 0.
    const auto u = [](const Int3& p) {
        return static_cast<double>(p.x + p.y) + (p == Int3{1, 1, 0} ? 0.3 : 0.0);
    };
    const BisectionOracle oracle({3, 3, 1}, u);
    const OracleNode& centre = oracle.nodes().at({1, 1, 0});
    const double turn = std::hypot(0.7 / std::hypot(0.7, 1.0) - std::sqrt(0.5),
                                   1 / std::hypot(0.7, 1.0) - std::sqrt(0.5));
    CHECK(turn > 0.17);
    CHECK(centre.of(Field::normal_plus) < 0.01);
    CHECK(centre.of(Field::normal_turn_plus) >= turn - 1e-9);
}
