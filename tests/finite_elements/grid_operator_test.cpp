// z = A w on implicit grids compared with assembled matrices on grids by explicit bisection.
#include "query/finite_elements/grid_operator.h"

#include <catch2/catch.hpp>

#include "query/finite_elements/active_nodes.h"
#include "tests/support/bisection_oracle.h"
#include "tests/support/explicit_grid.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// A pseudo-random number in [0, 1) for a node and a seed.
double hashed(const Int3& p, std::uint64_t seed) {
    std::uint64_t h = seed * 0x9E3779B97F4A7C15U;
    for (int a = 0; a < 3; ++a) {
        h = (h ^ static_cast<std::uint64_t>(p[a])) * 0xBF58476D1CE4E5B9U;
        h ^= h >> 29U;
    }
    return static_cast<double>(h >> 11U) * 0x1p-53;
}

/// Refines few nodes, more often near a corner.
bool some(const Int3& p, int level) {
    const double near = 8.0 / static_cast<double>(8 + p.x + p.y + p.z);
    return hashed(p, static_cast<std::uint64_t>(level)) < 0.12 * near;
}

template <int D>
struct Local {
    const Simplex& s;
    double factor;
    std::array<Double3, 4> g;
    Local(const Simplex& simplex, double a)
        : s(simplex), factor(a * simplex.measure()), g(simplex.gradient_weights()) {}
    double operator()(std::size_t i, std::size_t j) const { return factor * dot(g[i], g[j]); }
};

template <class Real>
void require_near(const Eigen::VectorXd& expected, const std::vector<Real>& found) {
    const double scale = expected.cwiseAbs().maxCoeff();
    const double most = scale * (sizeof(Real) == 4 ? 4e-6 : 1e-13);
    double worst = 0;
    for (std::size_t i = 0; i < found.size(); ++i) {
        worst = std::max(worst, std::fabs(expected[static_cast<int>(i)] - found[i]));
    }
    CAPTURE(scale, worst);
    CHECK(worst <= most);
}

template <class Real, int D>
void require_products(const Int3& n, const Double3& spacing,
                      const std::function<bool(const Int3&, int)>& wanted) {
    CAPTURE(n.x, n.y, n.z, spacing[0], spacing[2]);
    const Lattice lattice(n);
    const ExplicitGrid<D> grid(lattice, wanted);
    const NodeSet set = active_nodes(lattice, wanted, 2, silent_progress());
    REQUIRE(set.count() == grid.count());
    std::size_t differing = 0;
    for (std::int64_t i = 0; i < n.product(); ++i) {
        const Int3 p = n.unlinear(i);
        differing += set.contains(p) != grid.contains(p) ||
                     (set.contains(p) && set.number(p) != grid.number(p));
    }
    REQUIRE(differing == 0);

    const auto count = static_cast<std::size_t>(set.count());
    std::vector<Real> w(count);
    std::vector<Real> s(count);
    Eigen::VectorXd we(static_cast<int>(count));
    Eigen::VectorXd se(static_cast<int>(count));
    for (std::size_t i = 0; i < count; ++i) {
        w[i] = static_cast<Real>(hashed({static_cast<std::int64_t>(i), 0, 0}, 7) - 0.5);
        s[i] = static_cast<Real>(hashed({static_cast<std::int64_t>(i), 1, 0}, 7));
        we[static_cast<int>(i)] = w[i];
        se[static_cast<int>(i)] = s[i];
    }
    constexpr double kLambda = 0.7;
    constexpr double kScale = 1.75;
    constexpr std::uint64_t kAnyBytes = std::uint64_t{1} << 40U;
    const auto stiffness = grid.assemble(
        spacing, [&](const Simplex& x, const Element<D>&) { return Local<D>(x, kScale); });
    const auto weighted = grid.assemble(spacing, [&](const Simplex& x, const Element<D>& t) {
        const auto g = x.gradient_weights();
        Double3 grad{};
        for (std::size_t i = 0; i <= D; ++i) {
            for (std::size_t a = 0; a < 3; ++a) {
                grad[a] += g[i][a] * se[static_cast<int>(grid.number(t.v[i]))];
            }
        }
        return Local<D>(x, kScale / (1 + dot(grad, grad) / (kLambda * kLambda)));
    });
    const auto mass = grid.assemble(spacing, [&](const Simplex& x, const Element<D>&) {
        const double m = x.measure() / ((D + 1) * (D + 2));
        return [m](std::size_t i, std::size_t j) { return i == j ? 2 * m : m; };
    });
    const Coefficient<Real> perona_malik{s, kLambda};
    std::vector<std::vector<Real>> first;
    for (const int threads : {1, 3}) {
        GridOperator<Real> op(lattice, spacing, set, threads);
        std::vector<std::vector<Real>> z(12, std::vector<Real>(count, Real{17}));
        op.stiffness({}, kScale, w, z[0]);
        op.stiffness(perona_malik, kScale, w, z[1]);
        op.stiffness_diagonal({}, kScale, z[2]);
        op.stiffness_diagonal(perona_malik, kScale, z[3]);
        op.mass(w, z[4]);
        op.lumped_mass(z[5]);
        // Assembled: the product without the mass, the lumped mass, and the diagonals.
        std::size_t next = 6;
        for (const Coefficient<Real>& a : {Coefficient<Real>{}, perona_malik}) {
            std::vector<Real>& product = z[next++];
            std::vector<Real>& lumped = z[next++];
            std::vector<Real>& diagonal = z[next++];
            const auto matrix = op.assemble(a, kScale, lumped, diagonal, kAnyBytes);
            REQUIRE(matrix);
            matrix->multiply({}, w, product);
            std::vector<Real> with_mass(count, Real{17});
            matrix->multiply(lumped, w, with_mass);
            std::size_t wrong = 0;
            for (std::size_t i = 0; i < count; ++i) {
                const Real mass_part = lumped[i] * w[i];
                wrong += std::fabs(with_mass[i] - mass_part - product[i]) >
                         Real{4e-6F} * (std::fabs(mass_part) + 20 * kScale);
            }
            CHECK(wrong == 0);
            CHECK(!op.assemble(a, kScale, lumped, diagonal, matrix->heap() - 1));
            CHECK(op.assemble(a, kScale, lumped, diagonal, matrix->heap()));
        }
        if (threads == 1) {
            require_near<Real>(stiffness * we, z[0]);
            require_near<Real>(weighted * we, z[1]);
            require_near<Real>(stiffness.diagonal(), z[2]);
            require_near<Real>(weighted.diagonal(), z[3]);
            require_near<Real>(mass * we, z[4]);
            const Eigen::VectorXd lumped = mass * Eigen::VectorXd::Ones(static_cast<int>(count));
            require_near<Real>(lumped, z[5]);
            require_near<Real>(stiffness * we, z[6]);
            require_near<Real>(lumped, z[7]);
            require_near<Real>(stiffness.diagonal(), z[8]);
            require_near<Real>(weighted * we, z[9]);
            require_near<Real>(lumped, z[10]);
            require_near<Real>(weighted.diagonal(), z[11]);
            first = z;
        } else {
            CHECK(z == first);
        }
    }
}

template <class Real>
void require_all() {
    const std::array<std::function<bool(const Int3&, int)>, 3> sets{
        some, [](const Int3&, int) { return true; }, [](const Int3&, int) { return false; }};
    for (const auto& wanted : sets) {
        for (const Int3& n : {Int3{17, 17, 17}, Int3{2, 2, 2}, Int3{3, 2, 2}, Int3{12, 7, 9},
                              Int3{35, 20, 3}, Int3{5, 4, 18}}) {
            require_products<Real, 3>(n, {1, 1, 1}, wanted);
            require_products<Real, 3>(n, {0.5, 1.25, 3}, wanted);
        }
        for (const Int3& n :
             {Int3{65, 65, 1}, Int3{2, 2, 1}, Int3{70, 23, 1}, Int3{9, 1, 14}, Int3{1, 131, 5}}) {
            require_products<Real, 2>(n, {0.5, 1.25, 3}, wanted);
        }
        for (const Int3& n :
             {Int3{2, 1, 1}, Int3{1, 1, 37}, Int3{1030, 1, 1}, Int3{1, 700, 1}, Int3{1, 1, 1100}}) {
            require_products<Real, 1>(n, {0.5, 1.25, 3}, wanted);
        }
    }
}

}  // namespace

TEST_CASE("products on implicit grids are those of the assembled matrices, in float64") {
    require_all<double>();
}

TEST_CASE("products on implicit grids are those of the assembled matrices, in float32") {
    require_all<float>();
}

TEST_CASE("the gradient's indicator refines the same nodes as explicit bisection") {
    const auto value = [](const Int3& p) { return smooth(p) + 0.2 * noise(p); };
    for (const Int3& n : {Int3{17, 17, 17}, Int3{33, 33, 1}, Int3{1, 9, 9}, Int3{65, 1, 1}}) {
        CAPTURE(n.x, n.y, n.z);
        const Double3 spacing{0.5, 1.25, 3};
        const Lattice lattice(n);
        const BisectionOracle oracle(
            n,
            [&](const Int3& p) {
                return value(min(p, n - Int3{1, 1, 1}));
            },
            spacing);
        std::vector<double> values(static_cast<std::size_t>(n.product()));
        double largest = 0;
        for (std::size_t i = 0; i < values.size(); ++i) {
            values[i] = value(n.unlinear(static_cast<std::int64_t>(i)));
        }
        for (const auto& [p, node] : oracle.nodes()) {
            largest = std::max(largest, node.of(Field::grad_linf_bar));
        }
        for (const double part : {0.0, 0.0503, 0.2017, 0.6, 1.1}) {
            const double threshold = part * largest;
            const NodeSet set =
                active_nodes<double>(lattice, spacing, values, threshold, 2, silent_progress());
            std::size_t differing = 0;
            for (const auto& [p, node] : oracle.nodes()) {
                differing += (node.of(Field::grad_linf_bar) >= threshold) !=
                             set.contains({p[0], p[1], p[2]});
            }
            CHECK(differing == 0);
            CHECK((part > 0 || set.is_full()));
            const std::uint64_t corners = 1U << static_cast<unsigned>(lattice.dimension());
            CHECK((part < 1 || set.count() == corners));
        }
    }
}
