// Linear finite elements on an adaptive grid that is not stored: -div(a grad u) = f in the unit
// cube with u = 0 on its boundary, where a is 1 or, in a ball, 100. The local matrix is the
// program's own; the grid is fine where the coefficient jumps.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <vector>

#include <isonest/operator.h>

namespace {

double distance_to_ball(const isonest::Double3& at) {
    return std::hypot(at[0] - 0.5, at[1] - 0.5, at[2] - 0.5) - 0.3;
}

double coefficient(const isonest::Double3& at) {
    return distance_to_ball(at) < 0 ? 100 : 1;
}

}  // namespace

int main() {
    constexpr std::int64_t kCells = 64;
    constexpr double kStep = 1.0 / kCells;
    const isonest::Int3 nodes{kCells + 1, kCells + 1, kCells + 1};
    const isonest::Double3 spacing{kStep, kStep, kStep};

    // Refine every cube that the ball's surface may cross.
    const auto grid =
        isonest::ImplicitGrid<3>::of_nodes(nodes, spacing, [&](const isonest::Int3& p, int level) {
            const isonest::Double3 at{static_cast<double>(p.x) * kStep,
                                      static_cast<double>(p.y) * kStep,
                                      static_cast<double>(p.z) * kStep};
            return level > 3 || std::fabs(distance_to_ball(at)) < std::ldexp(kStep, level);
        });

    // The paper's SimplexAction: the local matrix of an element, with a at its centre.
    const auto centre = [&](const isonest::GridElement<3>& t) {
        isonest::Double3 sum{};
        for (const isonest::Int3& p : t.vertex) {
            const isonest::Double3 at = grid.position(p);
            for (std::size_t axis = 0; axis < 3; ++axis) {
                sum[axis] += at[axis] / 4;
            }
        }
        return sum;
    };
    const auto a = isonest::local_operator<double>(grid, [&](const isonest::GridElement<3>& t) {
        return isonest::stiffness_matrix(*t.shape, coefficient(centre(t)));
    });

    // The right-hand side, f = 1, and the nodes at which u is given.
    std::vector<double> b = isonest::MassAndStiffness<3, double>(grid).lumped_mass();
    std::vector<std::uint8_t> fixed(grid.count());
    grid.for_each_node([&](const isonest::Int3& p, std::size_t number) {
        fixed[number] = grid.on_boundary(p) ? 1 : 0;
    });

    const auto solve = [&](const char* name, const isonest::LinearMap<double>& precondition) {
        std::vector<double> u(grid.count());
        const isonest::SolverResult result = isonest::conjugate_gradients<double>(
            a, precondition, b, u, {.tolerance = 1e-8, .fixed = fixed});
        std::printf("%s: %d iterations\n", name, result.iterations);
        return u;
    };
    const std::vector<double> diagonal = a.diagonal();
    solve("Jacobi", isonest::Jacobi(diagonal));
    const std::vector<double> u =
        solve("multilevel", isonest::Multilevel<3, double>(grid, {.fixed = fixed}, diagonal));

    // The energy of the solution is the work of f, because A u = b at the inner nodes.
    std::vector<double> au(u.size());
    a(u, au);
    double energy = 0;
    double work = 0;
    for (std::size_t i = 0; i < u.size(); ++i) {
        energy += u[i] * au[i];
        work += u[i] * b[i];
    }
    std::printf("%zu of %lld nodes, energy %.8f, work %.8f\n", u.size(),
                static_cast<long long>(nodes.product()), energy, work);
    return 0;
}
