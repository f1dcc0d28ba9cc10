// Poisson's equation on implicit grids through the public interface: iterations and time by levels,
// with Jacobi's and with the multilevel preconditioner, and unknowns per second of z = A w.
//
// usage: isonest_poisson [THREADS [N...]]        (1 65 129 257)
//
// -laplace u = f with u = 0 on the boundary of a cube of N^3 nodes, in double precision, to a
// residual of 1e-8; on all nodes, and on those near a sphere, where the element size falls to that
// of the lattice. Jacobi's preconditioner is left out for more than 129^3 nodes. Times are
// processor times, those of a product the medians of seven.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <vector>

#include <isonest/operator.h>

using namespace isonest;

namespace {

/// Processor time so far.
double seconds() {
    return static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

template <class F>
double median_seconds(const F& f, int rounds = 7) {
    std::vector<double> times;
    for (int i = 0; i < rounds; ++i) {
        const double start = seconds();
        f();
        times.push_back(seconds() - start);
    }
    std::sort(times.begin(), times.end());
    return times[times.size() / 2];
}

template <class Real>
void measure_products(const char* name, const ImplicitGrid<3>& grid) {
    std::vector<Real> w(grid.count());
    std::vector<Real> z(grid.count());
    grid.for_each_node([&](const Int3& p, std::size_t i) {
        w[i] = static_cast<Real>(std::sin(0.1 * static_cast<double>(p.x + 2 * p.y - p.z)));
    });
    const auto count = static_cast<double>(grid.count());
    const MassAndStiffness<3, Real> ready(grid);
    const auto own = local_operator<Real>(
        grid, [](const GridElement<3>& t) { return stiffness_matrix<Real>(*t.shape); });
    const Multilevel<3, Real> multilevel(grid);
    fmt::print(
        "   {}: stiffness {:.1f} M unknowns/s, with the caller's matrix {:.1f} M/s, "
        "multilevel {:.1f} M/s, {:.1f} bytes per unknown\n",
        name, count / median_seconds([&] { ready.stiffness(w, z); }) / 1e6,
        count / median_seconds([&] { own(w, z); }, 3) / 1e6,
        count / median_seconds([&] { multilevel(w, z); }) / 1e6,
        static_cast<double>(multilevel.heap()) / count);
}

void solve(const ImplicitGrid<3>& grid, bool with_jacobi) {
    std::vector<std::uint8_t> fixed(grid.count());
    grid.for_each_node(
        [&](const Int3& p, std::size_t i) { fixed[i] = grid.on_boundary(p) ? 1 : 0; });
    const MassAndStiffness<3, double> matrices(grid);
    const LinearMap<double> product = [&](std::span<const double> w, std::span<double> z) {
        matrices.stiffness(w, z);
    };
    // f = 1, and more near a corner.
    std::vector<double> b = matrices.lumped_mass();
    const auto n = static_cast<double>(grid.nodes().nodes().x);
    grid.for_each_node([&](const Int3& p, std::size_t i) {
        const double r = std::hypot(static_cast<double>(p.x), static_cast<double>(p.y),
                                    static_cast<double>(p.z)) /
                         n;
        b[i] *= 1 + 10 * std::exp(-100 * r * r);
    });
    const auto run = [&](const char* name, const LinearMap<double>& precondition) {
        std::vector<double> x(grid.count());
        const double start = seconds();
        const SolverResult result = conjugate_gradients<double>(
            product, precondition, b, x,
            {.tolerance = 1e-8, .max_iterations = 1000, .threads = grid.threads(), .fixed = fixed});
        fmt::print("   {}: {} iterations{}, {:.2f} s\n", name, result.iterations,
                   result.converged ? "" : " (not converged)", seconds() - start);
        std::fflush(stdout);
    };
    const double start = seconds();
    const Multilevel<3, double> multilevel(grid, {.fixed = fixed});
    fmt::print("   multilevel made in {:.2f} s\n", seconds() - start);
    run("multilevel", multilevel);
    if (with_jacobi) {
        run("Jacobi", Jacobi(matrices.stiffness_diagonal()));
    }
}

}  // namespace

int main(int argc, char** argv) {
    const int threads = argc > 1 ? std::atoi(argv[1]) : 1;
    std::vector<std::int64_t> sizes;
    for (int i = 2; i < argc; ++i) {
        sizes.push_back(std::atoll(argv[i]));
    }
    if (sizes.empty()) {
        sizes = {65, 129, 257};
    }
    for (const std::int64_t n : sizes) {
        const ImplicitGrid<3> whole({n, n, n}, {1, 1, 1}, threads);
        const auto nodes = static_cast<double>(n * n * n);
        fmt::print("{}^3, all {} nodes, {:.2f} bytes of nodes per unknown\n", n, whole.count(),
                   static_cast<double>(whole.nodes().heap()) / nodes);
        measure_products<float>("float", whole);
        measure_products<double>("double", whole);
        solve(whole, n <= 129);
        const auto c = static_cast<double>(n - 1) / 2;
        const auto graded = ImplicitGrid<3>::of_nodes(
            {n, n, n}, {1, 1, 1},
            [&](const Int3& p, int level) {
                const double r =
                    std::hypot(static_cast<double>(p.x) - c, static_cast<double>(p.y) - c,
                               static_cast<double>(p.z) - c);
                return std::fabs(r - 0.6 * c) < std::ldexp(1.0, level);
            },
            threads);
        HashedNumbering numbering;
        std::uint64_t elements = 0;
        graded.for_each_element(numbering, [&](const GridElement<3>&) { ++elements; });
        const auto count = static_cast<double>(graded.count());
        fmt::print(
            "{}^3, {} nodes near a sphere ({:.1f} %), {:.2f} elements, {:.2f} bytes of nodes, "
            "{:.1f} of the hash table per unknown\n",
            n, graded.count(), 100 * count / nodes, static_cast<double>(elements) / count,
            static_cast<double>(graded.nodes().heap()) / count,
            static_cast<double>(numbering.heap()) / count);
        measure_products<float>("float", graded);
        measure_products<double>("double", graded);
        solve(graded, true);
    }
    return 0;
}
