// Computations on implicit grids: solutions compared with exact ones and dense algebra, and the
// guaranteed properties of diffusion.
#include "query/finite_elements/nonlinear_diffusion.h"

#include <Eigen/Dense>
#include <Eigen/SparseCholesky>
#include <catch2/catch.hpp>

#include "query/finite_elements/active_nodes.h"
#include "query/finite_elements/conjugate_gradients.h"
#include "query/finite_elements/grid_elements.h"
#include "query/finite_elements/grid_operator.h"
#include "tests/support/explicit_grid.h"
#include "tests/support/leaf_sets.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr double kPi = 3.14159265358979323846;

std::vector<float> image(const Int3& n) {
    std::vector<float> values;
    for (std::int64_t i = 0; i < n.product(); ++i) {
        const Int3 p = n.unlinear(i);
        values.push_back(
            static_cast<float>((p.x + p.y > p.z + n.x / 2 ? 100.0 : 20.0) + 10 * noise(p)));
    }
    return values;
}

/// The largest error at a node of -Laplace u = f with u = 0 on the border, u = prod sin(pi x).
template <int D>
double poisson_error(std::int64_t n, const std::function<bool(const Int3&, int)>& wanted) {
    const Int3 nodes{n, D > 1 ? n : 1, D > 2 ? n : 1};
    const Lattice lattice(nodes);
    const double h = 1 / static_cast<double>(n - 1);
    const Double3 spacing{h, h, h};
    const NodeSet set = active_nodes(lattice, wanted, 1, silent_progress());
    GridOperator<double> op(lattice, spacing, set, 2);
    const auto count = static_cast<std::size_t>(set.count());
    std::vector<double> exact;
    std::vector<double> inside;
    for (std::int64_t i = 0; i < nodes.product(); ++i) {
        const Int3 p = nodes.unlinear(i);
        if (set.contains(p)) {
            double u = 1;
            double in = 1;
            for (int a = 0; a < D; ++a) {
                u *= std::sin(kPi * h * static_cast<double>(p[a]));
                in *= p[a] > 0 && p[a] + 1 < n ? 1 : 0;
            }
            exact.push_back(u);
            inside.push_back(in);
        }
    }
    std::vector<double> r(count);
    std::vector<double> f = exact;
    for (double& v : f) {
        v *= D * kPi * kPi;
    }
    op.mass(f, r);
    std::vector<double> diagonal(count);
    op.stiffness_diagonal({}, 1, diagonal);
    for (std::size_t i = 0; i < count; ++i) {
        r[i] *= inside[i];
    }
    std::vector<double> x(count);
    std::vector<double> p(count);
    std::vector<double> z(count);
    const auto multiply = [&](std::span<const double> w, std::span<double> out) {
        op.stiffness({}, 1, w, out);
        for (std::size_t i = 0; i < count; ++i) {
            out[i] *= inside[i];
        }
    };
    const SolverReport solved = conjugate_gradients<double>(multiply, diagonal, {x, r, p, z}, 1e-12,
                                                            1000, silent_progress());
    REQUIRE(solved.residual <= 1e-12);
    double worst = 0;
    for (std::size_t i = 0; i < count; ++i) {
        worst = std::max(worst, std::fabs(x[i] - exact[i]));
    }
    return worst;
}

template <int D>
void require_second_order(std::int64_t n, const std::vector<int>& levels) {
    CAPTURE(D, n);
    double uniform = 0;
    double adaptive = 0;
    for (const int finest : levels) {
        const double u =
            poisson_error<D>(n, [&](const Int3&, int level) { return level > finest; });
        // Twice as fine in a corner.
        const double a = poisson_error<D>(n, [&](const Int3& p, int level) {
            return level > finest - (std::max({p.x, p.y, p.z}) < n / 2 ? 1 : 0);
        });
        CAPTURE(finest, u, a);
        if (uniform > 0) {
            CHECK(uniform / u > 3.5);
            CHECK(uniform / u < 4.5);
            CHECK(adaptive / a > 3.3);
            CHECK(adaptive / a < 4.7);
        }
        uniform = u;
        adaptive = a;
    }
}

/// sum |E| lambda^2 / 2 log(1 + |grad u|^2 / lambda^2): the energy that Perona-Malik diffusion
/// decreases.
double energy(const ExplicitGrid<3>& grid, const Double3& spacing, const Int3& n,
              std::span<const float> u, double lambda) {
    double sum = 0;
    static_cast<void>(grid.assemble(spacing, [&](const Simplex& s, const Element<3>& t) {
        const auto g = s.gradient_weights();
        Double3 grad{};
        for (std::size_t i = 0; i < 4; ++i) {
            for (std::size_t a = 0; a < 3; ++a) {
                grad[a] +=
                    g[i][a] * static_cast<double>(u[static_cast<std::size_t>(n.linear(t.v[i]))]);
            }
        }
        sum += s.measure() * lambda * lambda / 2 * std::log1p(dot(grad, grad) / (lambda * lambda));
        return [](std::size_t, std::size_t) { return 0.0; };
    }));
    return sum;
}

/// The largest off-diagonal entry of a stiffness matrix with equal spacings and coefficients that
/// differ between elements.
template <int D>
double largest_coupling(const Int3& n, const std::function<bool(const Int3&, int)>& wanted) {
    const ExplicitGrid<D> grid(Lattice(n), wanted);
    std::uint64_t element = 0;
    const auto matrix = grid.assemble({1, 1, 1}, [&](const Simplex& s, const Element<D>&) {
        const double a = 0.1 + noise({0, 0, 0}, ++element);
        return [a, &s, g = s.gradient_weights()](std::size_t i, std::size_t j) {
            return a * s.measure() * dot(g[i], g[j]);
        };
    });
    double largest = -1e30;
    for (int row = 0; row < matrix.outerSize(); ++row) {
        for (Eigen::SparseMatrix<double>::InnerIterator it(matrix, row); it; ++it) {
            if (it.row() != it.col()) {
                largest = std::max(largest, it.value());
            }
        }
    }
    return largest;
}

}  // namespace

TEST_CASE("a Poisson problem converges with the square of the element size") {
    require_second_order<1>(257, {5, 4, 3, 2});
    require_second_order<2>(129, {4, 3, 2, 1});
    require_second_order<3>(65, {3, 2, 1});
}

TEST_CASE("a step of diffusion is the solution of the assembled system") {
    const Int3 n{11, 9, 7};
    const Double3 spacing{0.5, 1, 1.25};
    const Lattice lattice(n);
    for (const double threshold : {0.0, 60.0}) {
        CAPTURE(threshold);
        const std::vector<float> before = image(n);
        SmoothOptions options;
        options.sigma = 0;
        options.tau = 0.3;
        options.lambda = 15;
        options.threshold = threshold;
        options.threads = 2;
        NonlinearDiffusion diffusion(lattice, spacing, before, options);
        const NodeSet set = diffusion.grid(silent_progress());
        CHECK(set.is_full() == (threshold == 0));
        const SmoothStep report = diffusion.step(silent_progress());
        CHECK(report.unknowns == set.count());
        const ExplicitGrid<3> grid(lattice, [&](const Int3& p, int) { return set.contains(p); });
        REQUIRE(grid.count() == set.count());
        Eigen::VectorXd u(static_cast<int>(grid.count()));
        for (std::int64_t i = 0; i < n.product(); ++i) {
            if (grid.contains(n.unlinear(i))) {
                u[static_cast<int>(grid.number(n.unlinear(i)))] =
                    before[static_cast<std::size_t>(i)];
            }
        }
        Eigen::SparseMatrix<double> a =
            grid.assemble(spacing, [&](const Simplex& s, const Element<3>& t) {
                const auto g = s.gradient_weights();
                Double3 grad{};
                for (std::size_t i = 0; i < 4; ++i) {
                    for (std::size_t k = 0; k < 3; ++k) {
                        grad[k] += g[i][k] * u[static_cast<int>(grid.number(t.v[i]))];
                    }
                }
                const double c = options.tau * s.measure() / (1 + dot(grad, grad) / (15.0 * 15.0));
                return [=](std::size_t i, std::size_t j) { return c * dot(g[i], g[j]); };
            });
        const Eigen::SparseMatrix<double> mass =
            grid.assemble(spacing, [](const Simplex& s, const Element<3>&) {
                const double m = s.measure() / 4;
                return [=](std::size_t i, std::size_t j) { return i == j ? m : 0; };
            });
        a += mass;
        const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(a);
        const Eigen::VectorXd after = solver.solve(mass * u);
        double worst = 0;
        for (std::int64_t i = 0; i < n.product(); ++i) {
            if (grid.contains(n.unlinear(i))) {
                worst =
                    std::max(worst, std::fabs(after[static_cast<int>(grid.number(n.unlinear(i)))] -
                                              diffusion.values()[static_cast<std::size_t>(i)]));
            }
        }
        CHECK(worst < 1e-3);
    }
}

TEST_CASE(
    "diffusion preserves the mean and the range, lowers the energy, and does not depend on "
    "threads") {
    const Int3 n{17, 20, 12};
    const Lattice lattice(n);
    for (const double threshold : {0.0, 40.0}) {
        CAPTURE(threshold);
        SmoothOptions options;
        options.sigma = 0;
        options.tau = 2;
        options.lambda = 10;
        options.threshold = threshold;
        options.threads = 1;
        NonlinearDiffusion one(lattice, {1, 1, 1}, image(n), options);
        options.threads = 3;
        NonlinearDiffusion three(lattice, {1, 1, 1}, image(n), options);
        const auto [low, high] = std::minmax_element(one.values().begin(), one.values().end());
        double least = *low;
        double largest = *high;
        double variance = 1e30;
        for (int step = 0; step < 6; ++step) {
            const NodeSet set = one.grid(silent_progress());
            const ExplicitGrid<3> grid(lattice,
                                       [&](const Int3& p, int) { return set.contains(p); });
            const double before = energy(grid, {1, 1, 1}, n, one.values(), options.lambda);
            const std::vector<float> first(one.values().begin(), one.values().end());
            const SmoothStep report = one.step(silent_progress());
            three.step(silent_progress());
            CHECK(std::equal(one.values().begin(), one.values().end(), three.values().begin()));
            CHECK(energy(grid, {1, 1, 1}, n, one.values(), options.lambda) < before);
            CHECK(report.least >= least - 1e-4);
            CHECK(report.largest <= largest + 1e-4);
            CHECK((report.variance < variance || step == 0));
            least = report.least;
            largest = report.largest;
            variance = report.variance;
            // The integral of the grid's function.
            const auto integral = [&](std::span<const float> u) {
                double sum = 0;
                for (const Element<3>& t : grid.leaves()) {
                    for (const Int3& p : t.v) {
                        sum += std::ldexp(1.0 / 24, 3 * t.level - t.kind) *
                               u[static_cast<std::size_t>(n.linear(p))];
                    }
                }
                return sum / static_cast<double>((n - Int3{1, 1, 1}).product());
            };
            CHECK(std::fabs(integral(first) - integral(one.values())) < 2e-5);
            CHECK(std::fabs(integral(first) - report.mean) < 2e-5);
        }
    }
    NonlinearDiffusion constant(lattice, {1, 1, 1},
                                std::vector<float>(static_cast<std::size_t>(n.product()), 7.25F),
                                {.sigma = 0.0});
    const SmoothStep report = constant.step(silent_progress());
    CHECK(report.iterations == 0);
    CHECK(std::all_of(constant.values().begin(), constant.values().end(),
                      [](float v) { return v == 7.25F; }));
}

TEST_CASE(
    "with equal spacings no coupling is positive in planes, nor in space if all nodes are active") {
    const auto few = [](const Int3& p, int level) {
        return noise(p, static_cast<std::uint64_t>(level)) < 0.1;
    };
    CHECK(largest_coupling<2>({17, 17, 1}, few) < 1e-12);
    CHECK(largest_coupling<2>({14, 1, 9}, few) < 1e-12);
    CHECK(largest_coupling<3>({5, 5, 5}, [](const Int3&, int) { return true; }) < 1e-12);
    // A tetrahedron after one bisection has an angle of 120 degrees.
    CHECK(largest_coupling<3>({3, 3, 3}, [](const Int3& p, int) {
              return p == Int3{1, 1, 1};
          }) > 1e-3);
}

TEST_CASE("in a plane with equal spacings no value leaves the range, with a threshold or without") {
    const Int3 n{33, 27, 1};
    for (const double threshold : {0.0, 15.0, 40.0}) {
        for (const double tau : {0.05, 0.5, 8.0}) {
            CAPTURE(threshold, tau);
            SmoothOptions options;
            options.sigma = 0;
            options.tau = tau;
            options.lambda = 10;
            options.threshold = threshold;
            NonlinearDiffusion diffusion(Lattice(n), {1, 1, 1}, image(n), options);
            for (int step = 0; step < 3; ++step) {
                const auto [low, high] =
                    std::minmax_element(diffusion.values().begin(), diffusion.values().end());
                const double least = *low;
                const double largest = *high;
                const SmoothStep report = diffusion.step(silent_progress());
                CHECK((report.unknowns < static_cast<std::uint64_t>(n.product())) ==
                      (threshold > 0));
                CHECK(report.least >= least - 1e-4);
                CHECK(report.largest <= largest + 1e-4);
            }
        }
    }
}

TEST_CASE("a grid's function at inactive nodes is the linear function of their element") {
    const Int3 n{13, 9, 10};
    const Lattice lattice(n);
    const auto wanted = [](const Int3& p, int level) {
        return noise(p, static_cast<std::uint64_t>(level)) < 0.1;
    };
    const NodeSet set = active_nodes(lattice, wanted, 1, silent_progress());
    REQUIRE(!set.is_full());
    const std::vector<float> values = image(n);
    std::vector<float> active(static_cast<std::size_t>(set.count()));
    std::vector<float> all(values.size(), -1);
    restrict_to(set, values, active);
    prolong<float>(lattice, set, active, all);
    const ExplicitGrid<3> grid(lattice, wanted);
    std::vector<int> seen(values.size());
    for (const Element<3>& t : grid.leaves()) {
        Eigen::Matrix4d m;
        for (int i = 0; i < 4; ++i) {
            const Int3& p = t.v[static_cast<std::size_t>(i)];
            m.col(i) << 1, p.x, p.y, p.z;
        }
        const Eigen::Matrix4d inverse = m.inverse();
        const auto [low, high] = t.bounds();
        for (std::int64_t z = low.z; z <= high.z; ++z) {
            for (std::int64_t y = low.y; y <= high.y; ++y) {
                for (std::int64_t x = low.x; x <= high.x; ++x) {
                    const Eigen::Vector4d b = inverse * Eigen::Vector4d(1, x, y, z);
                    if (b.minCoeff() < -1e-9) {
                        continue;
                    }
                    double u = 0;
                    for (int i = 0; i < 4; ++i) {
                        u += b[i] * values[static_cast<std::size_t>(
                                        n.linear(t.v[static_cast<std::size_t>(i)]))];
                    }
                    const auto at = static_cast<std::size_t>(n.linear({x, y, z}));
                    ++seen[at];
                    if (std::fabs(u - all[at]) > 1e-4) {
                        CHECK(u == all[at]);
                    }
                }
            }
        }
    }
    CHECK(std::all_of(seen.begin(), seen.end(), [](int count) { return count > 0; }));
}

TEST_CASE("both numberings give each node of the grid one number, in a store and in memory") {
    const Subject subject({17, 17, 17}, hills);
    ChunkCache cache(*subject.store, 1U << 22U);
    for (const double threshold : {0.0, 0.15, 0.6, 1e9}) {
        CAPTURE(threshold);
        const NodeSet set = active_nodes(cache, kStop, threshold, 2, silent_progress());
        const Leaves expected = by_traversal<3>(subject, Everything{}, threshold);
        NodeSampler sampler(cache);
        const auto refines = [&](const Element<3>& t) {
            return sampler.grid_indicator(t.ref_node(), kStop) >= threshold;
        };
        HashedNumbering hashed;
        LatticeNumbering array(subject.lattice().nodes());
        Leaves by_hash;
        Leaves by_array;
        std::map<std::uint64_t, std::array<std::int64_t, 3>> nodes;
        std::size_t wrong = 0;
        const InBox everywhere{volume_box(subject.lattice())};
        for_each_element<3>(subject.lattice(), everywhere, refines, hashed,
                            [&](const NumberedElement<3>& t) {
                                by_hash.insert(key_of(t.simplex.v));
                                for (std::size_t i = 0; i < 4; ++i) {
                                    const Int3& p = t.simplex.v[i];
                                    const std::array key{p.x, p.y, p.z};
                                    wrong += nodes.emplace(t.node[i], key).first->second != key;
                                }
                            });
        for_each_element<3>(
            subject.lattice(), everywhere, refines, array, [&](const NumberedElement<3>& t) {
                by_array.insert(key_of(t.simplex.v));
                for (std::size_t i = 0; i < 4; ++i) {
                    wrong += subject.lattice().nodes().unlinear(
                                 static_cast<std::int64_t>(t.node[i])) != t.simplex.v[i];
                }
            });
        CHECK(wrong == 0);
        CHECK(by_hash == expected);
        CHECK(by_array == expected);
        CHECK(nodes.size() == hashed.count());
        CHECK(hashed.count() == set.count());
        CHECK(hashed.heap() >= hashed.count() * 24);
    }
}

TEST_CASE("a Gaussian equals the sum over all nodes, mirrored at the border") {
    const Int3 n{7, 5, 9};
    const Double3 spacing{1, 0.5, 2};
    std::vector<float> values = image(n);
    const std::vector<float> before = values;
    const double sigma = 0.9;
    smooth_gaussian(values, n, spacing, sigma);
    std::array<std::vector<std::vector<double>>, 3> w;
    for (int axis = 0; axis < 3; ++axis) {
        const double s = sigma / spacing[static_cast<std::size_t>(axis)];
        const auto radius = std::min(static_cast<std::int64_t>(std::ceil(4 * s)), n[axis] - 1);
        auto& rows = w[static_cast<std::size_t>(axis)];
        rows.assign(static_cast<std::size_t>(n[axis]),
                    std::vector<double>(static_cast<std::size_t>(n[axis])));
        for (std::int64_t i = 0; i < n[axis]; ++i) {
            double sum = 0;
            for (std::int64_t k = -radius; k <= radius; ++k) {
                const double g = std::exp(-0.5 * static_cast<double>(k * k) / (s * s));
                std::int64_t j = i + k;
                j = j < 0 ? -j : j >= n[axis] ? 2 * (n[axis] - 1) - j : j;
                rows[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)] += g;
                sum += g;
            }
            for (double& v : rows[static_cast<std::size_t>(i)]) {
                v /= sum;
            }
        }
    }
    double worst = 0;
    for (std::int64_t i = 0; i < n.product(); ++i) {
        const Int3 p = n.unlinear(i);
        double sum = 0;
        for (std::int64_t j = 0; j < n.product(); ++j) {
            const Int3 q = n.unlinear(j);
            double weight = before[static_cast<std::size_t>(j)];
            for (int a = 0; a < 3; ++a) {
                weight *= w[static_cast<std::size_t>(a)][static_cast<std::size_t>(p[a])]
                           [static_cast<std::size_t>(q[a])];
            }
            sum += weight;
        }
        worst = std::max(worst, std::fabs(sum - values[static_cast<std::size_t>(i)]));
    }
    CHECK(worst < 1e-4);
}
