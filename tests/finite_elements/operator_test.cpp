// The public operators on implicit grids compared with assembled matrices on grids by explicit
// bisection, and the multilevel preconditioner with the sum that defines it.
#include <Eigen/Dense>
#include <catch2/catch.hpp>
#include <cmath>
#include <map>
#include <numbers>

#include <isonest/error.h>
#include <isonest/operator.h>

#include "query/finite_elements/active_nodes.h"
#include "tests/support/explicit_grid.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

using Wanted = std::function<bool(const Int3&, int)>;

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
bool all(const Int3& /*p*/, int /*level*/) {
    return true;
}
bool none(const Int3& /*p*/, int /*level*/) {
    return false;
}
/// Refines towards one corner to the finest level.
bool corner(const Int3& p, int level) {
    return std::max({p.x, p.y, p.z}) <= std::int64_t{1} << static_cast<unsigned>(level);
}

const Double3 kSpacing{0.5, 1.25, 3};

/// A value at a node, the same for all numberings.
double datum(const Int3& p, std::uint64_t which) {
    return hashed(p, 100 + which) - 0.3;
}

/// An entry of a local matrix that is not symmetric and depends on nodal data.
double entry(double measure, const Double3& gi, const Double3& gj, double mean, bool same,
             int vertices) {
    const double convection = 0.3 * gj[0] - 0.7 * gj[1] + 0.2 * gj[2];
    return measure * ((1 + mean * mean) * dot(gi, gj) + convection / vertices +
                      mean * (same ? 2.0 : 1.0) / (vertices * (vertices + 1)));
}

template <int D>
auto caller_matrix(const ImplicitGrid<D>& grid) {
    return [&grid](const GridElement<D>& t) {
        double mean = 0;
        for (const Int3& p : t.vertex) {
            CHECK_FALSE(!grid.nodes().contains(p));
            mean += datum(p, 3) / (D + 1);
        }
        LocalMatrix<double, D + 1> m;
        for (std::size_t i = 0; i <= D; ++i) {
            for (std::size_t j = 0; j <= D; ++j) {
                m[i][j] = entry(t.shape->measure, t.shape->gradient[i], t.shape->gradient[j], mean,
                                i == j, D + 1);
            }
        }
        return m;
    };
}

double worst_difference(const Eigen::VectorXd& expected, std::span<const double> found) {
    REQUIRE(static_cast<std::size_t>(expected.size()) == found.size());
    double worst = 0;
    for (std::size_t i = 0; i < found.size(); ++i) {
        worst = std::max(worst, std::fabs(expected[static_cast<int>(i)] - found[i]));
    }
    return worst;
}

template <int D>
void require_products(const Int3& n, const Wanted& wanted) {
    CAPTURE(n.x, n.y, n.z);
    const ExplicitGrid<D> expected(Lattice(n), wanted);
    const auto matrix = expected.assemble(kSpacing, [&](const Simplex& s, const Element<D>& t) {
        double mean = 0;
        for (const Int3& p : t.v) {
            mean += datum(p, 3) / (D + 1);
        }
        return [&s, mean, g = s.gradient_weights()](std::size_t i, std::size_t j) {
            return entry(s.measure(), g[i], g[j], mean, i == j, D + 1);
        };
    });
    std::vector<double> first;
    for (const int threads : {1, 3}) {
        const auto grid = ImplicitGrid<D>::of_nodes(n, kSpacing, wanted, threads);
        REQUIRE(grid.count() == expected.count());
        std::vector<double> w(grid.count());
        Eigen::VectorXd we(static_cast<int>(w.size()));
        grid.for_each_node([&](const Int3& p, std::size_t i) {
            CHECK_FALSE(expected.number(p) != i);
            w[i] = datum(p, 1);
            we[static_cast<int>(i)] = w[i];
        });
        const auto op = local_operator<double>(grid, caller_matrix<D>(grid));
        std::vector<double> z(w.size(), 17.0);
        op(w, z);
        const Eigen::VectorXd product = matrix * we;
        const double scale = 1e-12 * (1 + product.cwiseAbs().maxCoeff());
        CHECK(worst_difference(product, z) < scale);
        CHECK(worst_difference(matrix.diagonal(), op.diagonal()) < scale);
        if (threads == 1) {
            first = z;
        } else {
            CHECK(z == first);
        }

        // The hash table also numbers nodes beyond the lattice that the bisection passes.
        HashedNumbering numbering;
        std::map<std::uint64_t, Int3> visited;
        grid.for_each_element(numbering, [&](const GridElement<D>& t) {
            for (std::size_t i = 0; i <= D; ++i) {
                visited.emplace(t.node[i], t.vertex[i]);
            }
        });
        const std::uint64_t numbers = numbering.count();
        CHECK(visited.size() == grid.count());
        CHECK(visited.rbegin()->first < numbers);
        std::vector<double> hash_w(numbers);
        for (const auto& [number, p] : visited) {
            hash_w[number] = datum(p, 1);
        }
        std::vector<double> hash_z(numbers, 17.0);
        op(numbering, hash_w, hash_z);
        CHECK(numbering.count() == numbers);
        std::vector<double> ordered(w.size());
        for (const auto& [number, p] : visited) {
            ordered[grid.nodes().number(p)] = hash_z[number];
        }
        CHECK(worst_difference(product, ordered) < scale);

        const MassAndStiffness<D, double> ready(grid);
        const auto stiffness = local_operator<double>(
            grid, [](const GridElement<D>& t) { return stiffness_matrix(*t.shape); });
        const auto mass = local_operator<double>(
            grid, [](const GridElement<D>& t) { return mass_matrix(*t.shape); });
        std::vector<double> by_blocks(w.size());
        stiffness(w, z);
        ready.stiffness(w, by_blocks);
        CHECK(worst_difference(Eigen::Map<Eigen::VectorXd>(z.data(), we.size()), by_blocks) <
              scale);
        mass(w, z);
        ready.mass(w, by_blocks);
        CHECK(worst_difference(Eigen::Map<Eigen::VectorXd>(z.data(), we.size()), by_blocks) <
              scale);
    }
}

template <int D>
Eigen::SparseMatrix<double> laplacian(const ExplicitGrid<D>& grid, const Double3& spacing) {
    return grid.assemble(spacing, [](const Simplex& s, const Element<D>&) {
        return [&s, g = s.gradient_weights()](std::size_t i, std::size_t j) {
            return s.measure() * dot(g[i], g[j]);
        };
    });
}

/// The matrix of a function of vectors.
Eigen::MatrixXd dense(const LinearMap<double>& product, std::size_t size) {
    Eigen::MatrixXd m(size, size);
    std::vector<double> e(size);
    std::vector<double> z(size);
    for (std::size_t j = 0; j < size; ++j) {
        e[j] = 1;
        product(e, z);
        e[j] = 0;
        m.col(static_cast<int>(j)) = Eigen::Map<Eigen::VectorXd>(z.data(), m.rows());
    }
    return m;
}

template <int D>
std::vector<std::uint8_t> boundary(const ImplicitGrid<D>& grid) {
    std::vector<std::uint8_t> fixed(grid.count());
    grid.for_each_node(
        [&](const Int3& p, std::size_t i) { fixed[i] = grid.on_boundary(p) ? 1 : 0; });
    return fixed;
}

/// The smallest and largest eigenvalue of B A on the unknowns that are not fixed.
struct Spectrum {
    double low;
    double high;
};
Spectrum spectrum(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b,
                  const std::vector<std::uint8_t>& fixed) {
    std::vector<int> free;
    for (std::size_t i = 0; i < fixed.size(); ++i) {
        if (fixed[i] == 0) {
            free.push_back(static_cast<int>(i));
        }
    }
    const Eigen::MatrixXd inner_a = a(free, free);
    const Eigen::MatrixXd inner_b = b(free, free);
    CHECK((inner_b - inner_b.transpose()).cwiseAbs().maxCoeff() <
          1e-12 * inner_b.cwiseAbs().maxCoeff());
    const Eigen::LLT<Eigen::MatrixXd> root(inner_b);
    REQUIRE(root.info() == Eigen::Success);  // positive definite
    const Eigen::MatrixXd l = root.matrixL();
    const Eigen::VectorXd values =
        Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(l.transpose() * inner_a * l).eigenvalues();
    return {values[0], values[values.size() - 1]};
}

/// The sum that defines the preconditioner, from functions and matrices of each level by explicit
/// bisection. REQUIRES: a lattice of 2^k + 1 nodes.
template <int D>
Eigen::MatrixXd defined_preconditioner(const Int3& n, const Wanted& wanted,
                                       const std::vector<std::uint8_t>& fixed) {
    const Lattice lattice(n);
    const ExplicitGrid<D> finest(lattice, wanted);
    const auto size = static_cast<int>(finest.count());
    std::vector<Int3> nodes(finest.count());
    for (std::int64_t i = 0; i < n.product(); ++i) {
        if (const Int3 p = n.unlinear(i); finest.contains(p)) {
            nodes[finest.number(p)] = p;
        }
    }
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(size, size);
    std::vector<Eigen::VectorXd> known;
    for (int level = lattice.top(); level >= 0; --level) {
        // A node of level L refines if it is active in the finest grid.
        const ExplicitGrid<D> grid(
            lattice, [&](const Int3& p, int l) { return l > level && finest.contains(p); });
        const Eigen::SparseMatrix<double> a = laplacian(grid, kSpacing);
        std::vector<Eigen::VectorXd> functions(grid.count(), Eigen::VectorXd::Zero(size));
        for (int x = 0; x < size; ++x) {
            const auto spread = [&](const auto& self, const Int3& p, double part) -> void {
                if (grid.contains(p)) {
                    functions[grid.number(p)][x] += part;
                    return;
                }
                const NodeInfo info = describe_node(p, lattice.top());
                self(self, info.end0, part / 2);
                self(self, info.end1, part / 2);
            };
            spread(spread, nodes[static_cast<std::size_t>(x)], 1);
        }
        for (std::size_t i = 0; i < functions.size(); ++i) {
            const Eigen::VectorXd& f = functions[i];
            bool is_out = std::any_of(known.begin(), known.end(),
                                      [&](const Eigen::VectorXd& k) { return k == f; });
            for (int x = 0; x < size; ++x) {
                is_out = is_out || (fixed[static_cast<std::size_t>(x)] != 0 && f[x] != 0);
            }
            if (!is_out) {
                sum += f * f.transpose() / a.coeff(static_cast<int>(i), static_cast<int>(i));
            }
            known.push_back(f);
        }
    }
    return sum;
}

template <int D>
void require_definition(const Int3& n, const Wanted& wanted, bool is_fixed) {
    CAPTURE(n.x, n.y, n.z, is_fixed);
    const auto grid = ImplicitGrid<D>::of_nodes(n, kSpacing, wanted, 2);
    std::vector<std::uint8_t> fixed = boundary(grid);
    if (!is_fixed) {
        fixed.assign(fixed.size(), 0);
    }
    const Multilevel<D, double> multilevel(grid, {.fixed = fixed});
    const Eigen::MatrixXd found = dense(multilevel, grid.count());
    const Eigen::MatrixXd expected = defined_preconditioner<D>(n, wanted, fixed);
    REQUIRE(expected.rows() == found.rows());
    CHECK((expected - found).cwiseAbs().maxCoeff() <= 1e-12 * expected.cwiseAbs().maxCoeff());
}

/// -laplace u = f with u = product of sines on the boundary and inside, to a residual of 1e-9.
struct Solved {
    int iterations;
    double error;  ///< largest at a node
};
template <int D, class Precondition>
Solved solve_poisson(const ImplicitGrid<D>& grid, const Precondition& precondition,
                     const std::vector<std::uint8_t>& fixed) {
    constexpr double kPi = std::numbers::pi;
    const Int3 last = grid.nodes().nodes() - Int3{1, 1, 1};
    const Double3 end = grid.position(last);
    double factor = 0;
    for (const double e : end) {
        factor += e > 0 ? kPi * kPi / (e * e) : 0;
    }
    std::vector<double> exact(grid.count());
    std::vector<double> f(grid.count());
    std::vector<double> x(grid.count());
    grid.for_each_node([&](const Int3& p, std::size_t i) {
        const Double3 at = grid.position(p);
        double u = 1;
        for (std::size_t a = 0; a < 3; ++a) {
            u *= end[a] > 0 ? std::sin(kPi * at[a] / end[a] + 0.2) : 1;
        }
        exact[i] = u;
        f[i] = factor * u;
        x[i] = fixed[i] != 0 ? u : 0;
    });
    const MassAndStiffness<D, double> matrices(grid);
    std::vector<double> b(grid.count());
    matrices.mass(f, b);
    const SolverResult result = conjugate_gradients<double>(
        [&](std::span<const double> w, std::span<double> z) { matrices.stiffness(w, z); },
        precondition, b, x, {.tolerance = 1e-9, .threads = 2, .fixed = fixed});
    CHECK(result.converged);
    Solved solved{result.iterations, 0};
    for (std::size_t i = 0; i < x.size(); ++i) {
        solved.error = std::max(solved.error, std::fabs(x[i] - exact[i]));
        if (fixed[i] != 0) {
            CHECK_FALSE(x[i] != exact[i]);
        }
    }
    return solved;
}

template <int D>
Solved by_multilevel(const ImplicitGrid<D>& grid) {
    const std::vector<std::uint8_t> fixed = boundary(grid);
    return solve_poisson(grid, Multilevel<D, double>(grid, {.fixed = fixed}), fixed);
}

template <class F>
ErrorKind kind_of(const F& f) {
    try {
        f();
    } catch (const Error& error) {
        return error.kind();
    }
    FAIL("nothing was thrown");
    return ErrorKind::io;
}

}  // namespace

TEST_CASE("the caller's local matrices give the product of the assembled matrix") {
    for (const Wanted& wanted : {Wanted(some), Wanted(all), Wanted(none), Wanted(corner)}) {
        for (const Int3& n : {Int3{17, 17, 17}, Int3{2, 2, 2}, Int3{3, 2, 2}, Int3{12, 7, 9},
                              Int3{35, 20, 3}, Int3{5, 4, 18}}) {
            require_products<3>(n, wanted);
        }
        for (const Int3& n :
             {Int3{65, 65, 1}, Int3{2, 2, 1}, Int3{70, 23, 1}, Int3{9, 1, 14}, Int3{1, 131, 5}}) {
            require_products<2>(n, wanted);
        }
        for (const Int3& n : {Int3{2, 1, 1}, Int3{1, 1, 37}, Int3{600, 1, 1}, Int3{1, 300, 1}}) {
            require_products<1>(n, wanted);
        }
    }
}

TEST_CASE("with two unknowns for each node the product is that of the assembled matrix") {
    const Int3 n{12, 7, 9};
    const auto grid = ImplicitGrid<3>::of_nodes(n, kSpacing, some, 2);
    const ExplicitGrid<3> expected(Lattice(n), some);
    const auto stiffness = laplacian(expected, kSpacing);
    // Unknown 0 feels 2 B u + 0.5 B v, unknown 1 feels -B u + 3 B v.
    constexpr double kCoupling[2][2] = {{2, 0.5}, {-1, 3}};
    const auto op = local_operator<double, 2>(grid, [&](const GridElement<3>& t) {
        const auto b = stiffness_matrix(*t.shape);
        LocalMatrix<double, 8> m;
        for (std::size_t i = 0; i < 8; ++i) {
            for (std::size_t j = 0; j < 8; ++j) {
                m[i][j] = kCoupling[i % 2][j % 2] * b[i / 2][j / 2];
            }
        }
        return m;
    });
    const std::size_t count = grid.count();
    REQUIRE(op.size() == 2 * count);
    std::vector<double> w(2 * count);
    Eigen::VectorXd u(static_cast<int>(count));
    Eigen::VectorXd v(static_cast<int>(count));
    grid.for_each_node([&](const Int3& p, std::size_t i) {
        u[static_cast<int>(i)] = w[2 * i] = datum(p, 1);
        v[static_cast<int>(i)] = w[2 * i + 1] = datum(p, 2);
    });
    std::vector<double> z(2 * count);
    op(w, z);
    const Eigen::VectorXd zu = stiffness * (2 * u + 0.5 * v);
    const Eigen::VectorXd zv = stiffness * (-u + 3 * v);
    double worst = 0;
    for (std::size_t i = 0; i < count; ++i) {
        worst = std::max({worst, std::fabs(z[2 * i] - zu[static_cast<int>(i)]),
                          std::fabs(z[2 * i + 1] - zv[static_cast<int>(i)])});
    }
    CHECK(worst < 1e-11);

    // The preconditioner treats each unknown as if it were alone, with its own fixed nodes.
    std::vector<std::uint8_t> fixed(2 * count);
    std::vector<std::uint8_t> fixed_v(count);
    grid.for_each_node(
        [&](const Int3& p, std::size_t i) { fixed[2 * i + 1] = fixed_v[i] = p.x == 0 ? 1 : 0; });
    const Multilevel<3, double> both(grid, {.unknowns = 2, .fixed = fixed});
    both(w, z);
    std::vector<double> one(count);
    const Multilevel<3, double> single(grid);
    single(std::vector<double>(u.data(), u.data() + count), one);
    std::vector<double> other(count);
    Multilevel<3, double>(grid, {.fixed = fixed_v})(std::vector<double>(v.data(), v.data() + count),
                                                    other);
    std::size_t differing = 0;
    for (std::size_t i = 0; i < count; ++i) {
        differing += z[2 * i] != one[i] || z[2 * i + 1] != other[i] ? 1 : 0;
    }
    CHECK(differing == 0);
}

TEST_CASE("the multilevel preconditioner is the sum over the levels' different functions") {
    for (const bool is_fixed : {false, true}) {
        for (const Wanted& wanted : {Wanted(some), Wanted(all), Wanted(corner)}) {
            require_definition<1>({1, 33, 1}, wanted, is_fixed);
            require_definition<2>({17, 1, 17}, wanted, is_fixed);
            require_definition<3>({9, 9, 9}, wanted, is_fixed);
        }
    }
}

TEST_CASE("the multilevel preconditioner is symmetric, definite, and bounds the condition") {
    const auto require = [&]<int D>(const Int3& n, const Wanted& wanted, double most) {
        CAPTURE(n.x, n.y, n.z);
        const auto grid = ImplicitGrid<D>::of_nodes(n, {1, 1, 1}, wanted, 2);
        const ExplicitGrid<D> expected(Lattice(n), wanted);
        const Eigen::MatrixXd a = laplacian(expected, {1, 1, 1});
        const std::vector<std::uint8_t> fixed = boundary(grid);
        const Multilevel<D, double> multilevel(grid, {.fixed = fixed});
        const Spectrum s = spectrum(a, dense(multilevel, grid.count()), fixed);
        CHECK(s.low > 0);
        CHECK(s.high / s.low < most);
        // With the mass matrix and nothing fixed.
        const std::vector<std::uint8_t> free(fixed.size());
        const Multilevel<D, double> with_mass(grid, {.stiffness = 0.3, .mass = 2});
        const Eigen::MatrixXd mass =
            expected.assemble({1, 1, 1}, [](const Simplex& x, const Element<D>&) {
                const double m = x.measure() / ((D + 1) * (D + 2));
                return [m](std::size_t i, std::size_t j) { return i == j ? 2 * m : m; };
            });
        const Spectrum sm = spectrum(0.3 * a + 2 * mass, dense(with_mass, grid.count()), free);
        CHECK(sm.low > 0);
        CHECK(sm.high / sm.low < 2 * most);
    };
    for (const Wanted& wanted : {Wanted(some), Wanted(all), Wanted(corner)}) {
        require.operator()<1>({65, 1, 1}, wanted, 30);
        require.operator()<1>({1, 1, 50}, wanted, 30);
        require.operator()<2>({17, 17, 1}, wanted, 30);
        require.operator()<2>({14, 1, 23}, wanted, 40);
        require.operator()<3>({9, 9, 9}, wanted, 30);
        require.operator()<3>({7, 10, 6}, wanted, 40);
    }
}

TEST_CASE("the iterations for Poisson's equation do not grow with the number of levels") {
    std::vector<int> whole;
    std::vector<int> graded;
    std::vector<int> plane;
    for (int k = 3; k <= 6; ++k) {
        const std::int64_t n = (std::int64_t{1} << static_cast<unsigned>(k)) + 1;
        whole.push_back(by_multilevel(ImplicitGrid<3>({n, n, n})).iterations);
    }
    for (int k = 5; k <= 14; k += 3) {
        const std::int64_t n = (std::int64_t{1} << static_cast<unsigned>(k)) + 1;
        if (k <= 8) {
            graded.push_back(
                by_multilevel(ImplicitGrid<3>::of_nodes({n, n, n}, {1, 1, 1}, corner)).iterations);
        }
        if (k <= 11) {
            plane.push_back(
                by_multilevel(ImplicitGrid<2>::of_nodes({n, n, 1}, {1, 1, 1}, corner)).iterations);
        }
    }
    // Neither whole levels of the coarsest grid nor the volume's ends are needed.
    const int odd = by_multilevel(ImplicitGrid<3>({50, 37, 61})).iterations;
    CAPTURE(whole, graded, plane, odd);
    CHECK(whole.back() <= 44);
    CHECK(whole[3] - whole[2] <= 4);
    CHECK(whole[3] - whole[2] <= whole[2] - whole[1]);
    CHECK(graded.back() <= 25);
    CHECK(plane.back() <= 25);
    CHECK(odd <= 75);
}

TEST_CASE("Poisson's solution converges to the exact one with the square of the element size") {
    std::vector<double> errors;
    for (const std::int64_t n : {9, 17, 33}) {
        const ImplicitGrid<3> grid(
            {n, n, n}, {1.0 / static_cast<double>(n - 1), 2.0 / static_cast<double>(n - 1),
                        1.5 / static_cast<double>(n - 1)});
        const std::vector<std::uint8_t> fixed = boundary(grid);
        const Solved solved = by_multilevel(grid);
        const Solved by_jacobi = solve_poisson(
            grid, Jacobi(MassAndStiffness<3, double>(grid).stiffness_diagonal()), fixed);
        CHECK(std::fabs(solved.error - by_jacobi.error) < 1e-6);
        errors.push_back(solved.error);
    }
    CHECK(errors[0] / errors[1] > 3.2);
    CHECK(errors[1] / errors[2] > 3.6);
}

TEST_CASE("fixed unknowns keep their values, and the others solve the reduced system") {
    const Int3 n{7, 6, 5};
    const auto grid = ImplicitGrid<3>::of_nodes(n, kSpacing, some, 2);
    const ExplicitGrid<3> expected(Lattice(n), some);
    const Eigen::MatrixXd a = laplacian(expected, kSpacing);
    std::vector<std::uint8_t> fixed(grid.count());
    std::vector<double> x(grid.count());
    std::vector<double> b(grid.count());
    std::vector<int> free;
    grid.for_each_node([&](const Int3& p, std::size_t i) {
        fixed[i] = p.x == 0 || hashed(p, 5) < 0.2 ? 1 : 0;  // also single nodes inside
        x[i] = fixed[i] != 0 ? datum(p, 1) : 0;
        b[i] = datum(p, 2);
        if (fixed[i] == 0) {
            free.push_back(static_cast<int>(i));
        }
    });
    const std::vector<double> start = x;
    Eigen::VectorXd held = Eigen::Map<Eigen::VectorXd>(x.data(), a.rows());
    const Eigen::VectorXd right = Eigen::Map<Eigen::VectorXd>(b.data(), a.rows()) - a * held;
    const Eigen::VectorXd solution =
        Eigen::MatrixXd(a(free, free)).ldlt().solve(Eigen::VectorXd(right(free)));
    const auto op = local_operator<double>(
        grid, [](const GridElement<3>& t) { return stiffness_matrix(*t.shape); });
    const Multilevel<3, double> multilevel(grid, {.fixed = fixed});
    for (const int threads : {1, 3}) {
        std::vector<double> y = start;
        const SolverResult result = conjugate_gradients<double>(
            op, multilevel, b, y, {.tolerance = 1e-12, .threads = threads, .fixed = fixed});
        CHECK(result.converged);
        for (std::size_t i = 0, k = 0; i < y.size(); ++i) {
            if (fixed[i] != 0) {
                CHECK(y[i] == start[i]);
            } else {
                CHECK(std::fabs(y[i] - solution[static_cast<int>(k++)]) < 1e-9);
            }
        }
        if (threads == 1) {
            x = y;
        } else {
            CHECK(x == y);
        }
    }
}

TEST_CASE("a grid of values has the nodes of the threshold and interpolates the others") {
    const Int3 n{33, 20, 1};
    std::vector<double> values(static_cast<std::size_t>(n.product()));
    for (std::size_t i = 0; i < values.size(); ++i) {
        const Int3 p = n.unlinear(static_cast<std::int64_t>(i));
        values[i] = std::exp(-0.02 * static_cast<double>((p.x - 9) * (p.x - 9) + p.y * p.y));
    }
    const auto grid =
        ImplicitGrid<2>::of_values(n, kSpacing, std::span<const double>(values), 0.02);
    const NodeSet expected =
        active_nodes<double>(Lattice(n), kSpacing, values, 0.02, 1, silent_progress());
    REQUIRE(grid.count() == expected.count());
    REQUIRE(grid.count() < values.size() / 2);
    std::vector<double> active(grid.count());
    grid.for_each_node([&](const Int3& p, std::size_t i) {
        CHECK_FALSE(!expected.contains(p));
        active[i] = values[static_cast<std::size_t>(n.linear(p))];
    });
    std::vector<double> all_values(values.size());
    grid.interpolate(std::span<const double>(active), all_values);
    for (std::size_t i = 0; i < values.size(); ++i) {
        const Int3 p = n.unlinear(static_cast<std::int64_t>(i));
        if (expected.contains(p)) {
            CHECK_FALSE(all_values[i] != values[i]);
        } else {
            const NodeInfo info = describe_node(p, Lattice(n).top());
            const double mean = 0.5 * (all_values[static_cast<std::size_t>(n.linear(info.end0))] +
                                       all_values[static_cast<std::size_t>(n.linear(info.end1))]);
            CHECK_FALSE(all_values[i] != mean);
        }
    }
}

TEST_CASE("impossible grids and solvers are refused") {
    const std::vector<double> values(8);
    CHECK(kind_of([] { ImplicitGrid<3>({4, 4, 1}); }) == ErrorKind::invalid_argument);
    CHECK(kind_of([] { ImplicitGrid<2>({4, 4, 4}); }) == ErrorKind::invalid_argument);
    CHECK(kind_of([] { ImplicitGrid<1>({0, 4, 1}); }) == ErrorKind::invalid_argument);
    CHECK(kind_of([] { ImplicitGrid<1>({4, 1, 1}, {0, 1, 1}); }) == ErrorKind::invalid_argument);
    CHECK(kind_of([] {
              ImplicitGrid<1>({4, 1, 1}, {std::nan(""), 1, 1});
          }) == ErrorKind::invalid_argument);
    const auto of_values = [&](const Int3& n, double threshold) {
        return kind_of([&] {
            ImplicitGrid<3>::of_values(n, {1, 1, 1}, std::span<const double>(values), threshold);
        });
    };
    CHECK(of_values({2, 2, 3}, 1) == ErrorKind::invalid_argument);
    CHECK(of_values({2, 2, 2}, -1) == ErrorKind::invalid_argument);
    CHECK(of_values({2, 2, 2}, std::nan("")) == ErrorKind::invalid_argument);
    const ImplicitGrid<3> grid({2, 2, 2});
    const std::vector<std::uint8_t> few(7);
    using Levels = Multilevel<3, double>;
    CHECK(kind_of([&] { Levels(grid, {.fixed = few}); }) == ErrorKind::invalid_argument);
    CHECK(kind_of([&] { Levels(grid, {.stiffness = 0}); }) == ErrorKind::invalid_argument);
    CHECK(kind_of([&] { Levels(grid, {.mass = -1}); }) == ErrorKind::invalid_argument);
    CHECK(kind_of([&] { Levels(grid, {.unknowns = 0}); }) == ErrorKind::invalid_argument);
    const LinearMap<double> copy = [](std::span<const double> w, std::span<double> z) {
        std::copy(w.begin(), w.end(), z.begin());
    };
    std::vector<double> x(8);
    CHECK(kind_of([&] { conjugate_gradients<double>(copy, copy, values, x, {.fixed = few}); }) ==
          ErrorKind::invalid_argument);
    CHECK(kind_of([&] { conjugate_gradients<double>(copy, copy, values, x, {.tolerance = -1}); }) ==
          ErrorKind::invalid_argument);
}
