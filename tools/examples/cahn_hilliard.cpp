// Phase separation on adaptive grids that are not stored (Figure 7c of the paper shows a time step
// of such a simulation). u is the difference of two concentrations:
//
//     du/dt = laplace mu,    mu = W'(u) - eps^2 laplace u,    W(u) = (u^2 - 1)^2 / 4
//
// with linear elements, lumped masses M, the stiffness matrix B, and semi-implicit steps:
//
//     M (v - u) = -tau B mu,    M mu = eps^2 B v + 2 M v + M (W'(u) - 2 u)
//
// This splitting makes the energy fall for any tau while |u| < 1.29 (D. Eyre, "Unconditionally
// gradient stable time marching the Cahn-Hilliard equation", MRS Proc. 529, 1998). mu is
// eliminated:
//
//     (M + 2 tau B + tau eps^2 B M^-1 B) v = M u - tau B (W'(u) - 2 u)
//
// For tau >= eps^2 the matrix on the left is (M + a B) M^-1 (M + b B) with a + b = 2 tau, a b = tau
// eps^2: two systems of second order, solved with the multilevel preconditioner.
//
// Each grid is that of the last step's function, and one more layer of nodes of each level around,
// into which an interface can move.
//
// usage: cahn_hilliard [D [CELLS [STEPS [THRESHOLD]]]]        (2 64 20 0.01)
//
// writes u at all nodes as float64, x fastest: first.raw before the first step, last.raw at the
// end.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <optional>
#include <span>
#include <vector>

#include <isonest/operator.h>

namespace {

constexpr double kEps = 2;  // in spacings; an interface is about eight wide
constexpr double kTau = 8;  // at least kEps^2

double potential(double u) {
    return (u * u - 1) * (u * u - 1) / 4;
}
double explicit_part(double u) {
    return u * u * u - 3 * u;
}

/// Small, of many wavelengths, with a mean of about -0.2.
double start_value(const isonest::Int3& p) {
    const auto x = static_cast<double>(p.x);
    const auto y = static_cast<double>(p.y);
    const auto z = static_cast<double>(p.z);
    double u = -0.2;
    for (int k = 1; k <= 6; ++k) {
        u += 0.05 * std::sin(0.13 * k * x + 0.9 * k) * std::cos(0.11 * k * y + 0.07 * k * z + k);
    }
    return u;
}

void write(const char* name, std::span<const double> values) {
    std::ofstream(name, std::ios::binary)
        .write(reinterpret_cast<const char*>(values.data()),
               static_cast<std::streamsize>(values.size_bytes()));
}

/// The nodes of `grid`, and those one element of their level further.
template <int D>
isonest::ImplicitGrid<D> with_neighbours(const isonest::ImplicitGrid<D>& grid) {
    const isonest::NodeSet& set = grid.nodes();
    const isonest::Int3 n = set.nodes();
    return isonest::ImplicitGrid<
        D>::of_nodes(n, grid.spacing(), [&](const isonest::Int3& p, int level) {
        const std::int64_t step = std::int64_t{1} << level;
        for (int i = 0; i < 27; ++i) {
            const isonest::Int3 q = p + isonest::Int3{i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1} * step;
            if (isonest::max(q, {0, 0, 0}) == q &&
                isonest::min(q, n - isonest::Int3{1, 1, 1}) == q && set.contains(q)) {
                return true;
            }
        }
        return false;
    });
}

/// A time step's grid and matrices.
template <int D>
class Step {
  public:
    Step(const isonest::ImplicitGrid<D>& grid, std::span<const double> all)
        : grid_(grid),
          matrices_(grid),
          mass_(matrices_.lumped_mass()),
          u_(grid.count()),
          b_(grid.count()),
          c_(grid.count()) {
        grid.for_each_node([&](const isonest::Int3& p, std::size_t number) {
            u_[number] = all[static_cast<std::size_t>(grid.nodes().nodes().linear(p))];
        });
    }

    /// The integral of u.
    [[nodiscard]] double total() const {
        double sum = 0;
        for (std::size_t i = 0; i < u_.size(); ++i) {
            sum += mass_[i] * u_[i];
        }
        return sum;
    }
    /// Adds a constant, so that the integral has this value.
    void set_total(double wanted) {
        double volume = 0;
        for (const double m : mass_) {
            volume += m;
        }
        const double by = (wanted - total()) / volume;
        for (double& u : u_) {
            u += by;
        }
    }
    /// The integral of eps^2 / 2 |grad u|^2 + W(u).
    double energy() {
        matrices_.stiffness(u_, b_);
        double sum = 0;
        for (std::size_t i = 0; i < u_.size(); ++i) {
            sum += kEps * kEps / 2 * u_[i] * b_[i] + mass_[i] * potential(u_[i]);
        }
        return sum;
    }
    /// Returns the number of iterations.
    int advance() {
        const double before = total();
        for (std::size_t i = 0; i < u_.size(); ++i) {
            c_[i] = explicit_part(u_[i]);
        }
        matrices_.stiffness(c_, b_);
        for (std::size_t i = 0; i < u_.size(); ++i) {
            b_[i] = mass_[i] * u_[i] - kTau * b_[i];
        }
        const double root = std::sqrt(kTau * kTau - kTau * kEps * kEps);
        int iterations = solve(kTau + root, b_, u_);
        for (std::size_t i = 0; i < u_.size(); ++i) {
            b_[i] = mass_[i] * u_[i];
        }
        iterations += solve(kTau - root, b_, u_);
        set_total(before);  // what the solver left
        return iterations;
    }
    void interpolate(std::span<double> all) const { grid_.interpolate(u_, all); }
    [[nodiscard]] std::size_t count() const { return u_.size(); }

  private:
    /// (M + factor * B) x = b.
    int solve(double factor, std::span<const double> b, std::span<double> x) {
        const auto product = [&](std::span<const double> w, std::span<double> z) {
            matrices_.stiffness(w, z);
            for (std::size_t i = 0; i < z.size(); ++i) {
                z[i] = mass_[i] * w[i] + factor * z[i];
            }
        };
        const isonest::Multilevel<D, double> multilevel(grid_, {.stiffness = factor, .mass = 1});
        return isonest::conjugate_gradients<double>(product, multilevel, b, x, {.tolerance = 1e-9})
            .iterations;
    }

    isonest::ImplicitGrid<D> grid_;
    isonest::MassAndStiffness<D, double> matrices_;
    std::vector<double> mass_;
    std::vector<double> u_;
    std::vector<double> b_;
    std::vector<double> c_;
};

template <int D>
int simulate(std::int64_t cells, int steps, double threshold) {
    using Grid = isonest::ImplicitGrid<D>;
    const isonest::Int3 nodes{cells + 1, cells + 1, D == 3 ? cells + 1 : 1};
    std::vector<double> all(static_cast<std::size_t>(nodes.product()));
    for (std::size_t i = 0; i < all.size(); ++i) {
        all[i] = start_value(nodes.unlinear(static_cast<std::int64_t>(i)));
    }
    write("first.raw", all);
    std::optional<double> total;
    double last_energy = 0;
    double seconds = 0;
    for (int step = 0; step < steps; ++step) {
        const auto start = std::chrono::steady_clock::now();
        // The first grid has all nodes: no function has been smoothed yet.
        const Grid grid = step == 0 || threshold == 0
                              ? Grid(nodes)
                              : with_neighbours(Grid::of_values(
                                    nodes, {1, 1, 1}, std::span<const double>(all), threshold));
        Step<D> now(grid, all);
        if (!total) {
            total = now.total();
        }
        now.set_total(*total);  // what a coarser grid changed
        const double before = now.energy();
        const int iterations = now.advance();
        const double after = now.energy();
        now.interpolate(all);
        const double took =
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        seconds += took;
        std::printf(
            "step %d: %zu nodes (%.1f %%), %d iterations, energy %.9g -> %.9g, total "
            "changed by %.3g, %.3f s\n",
            step + 1, now.count(),
            100 * static_cast<double>(now.count()) / static_cast<double>(all.size()), iterations,
            before, after, now.total() - *total, took);
        if (after > before) {
            std::printf("the energy rose\n");
            return 1;
        }
        last_energy = after;
    }
    write("last.raw", all);
    std::printf("energy %.9g after %d steps in %.2f s\n", last_energy, steps, seconds);
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    const int dimension = argc > 1 ? std::atoi(argv[1]) : 2;
    const std::int64_t cells = argc > 2 ? std::atoll(argv[2]) : 64;
    const int steps = argc > 3 ? std::atoi(argv[3]) : 20;
    const double threshold = argc > 4 ? std::atof(argv[4]) : 0.01;
    return dimension == 3 ? simulate<3>(cells, steps, threshold)
                          : simulate<2>(cells, steps, threshold);
}
