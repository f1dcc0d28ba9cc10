#include <fmt/format.h>

#include <cmath>
#include <optional>

#include <isonest/error.h>
#include <isonest/operator.h>

#include "query/finite_elements/conjugate_gradients.h"
#include "query/finite_elements/grid_operator.h"
#include "query/finite_elements/grid_parts.h"

namespace isonest {
namespace detail {

template <int D, class Real>
struct MassAndStiffnessParts {
    ImplicitGrid<D> grid;
    GridOperator<Real> matrices;
    std::optional<GridMatrix<Real>> stiffness;  ///< where nodes are omitted

    explicit MassAndStiffnessParts(const ImplicitGrid<D>& on)
        : grid(on), matrices(on.parts().lattice, on.spacing(), grid.nodes(), on.threads()) {
        if (!grid.nodes().is_full()) {
            std::vector<Real> mass(grid.count());
            std::vector<Real> diagonal(grid.count());
            stiffness = matrices.assemble({}, 1, mass, diagonal, ~std::uint64_t{0});
        }
    }
};

}  // namespace detail

template <int D, class Real>
MassAndStiffness<D, Real>::MassAndStiffness(const ImplicitGrid<D>& grid)
    : parts_(std::make_shared<detail::MassAndStiffnessParts<D, Real>>(grid)) {}

template <int D, class Real>
void MassAndStiffness<D, Real>::mass(std::span<const Real> w, std::span<Real> z) const {
    parts_->matrices.mass(w, z);
}

template <int D, class Real>
void MassAndStiffness<D, Real>::stiffness(std::span<const Real> w, std::span<Real> z) const {
    if (parts_->stiffness) {
        parts_->matrices.workers().execute([&] { parts_->stiffness->multiply({}, w, z); });
    } else {
        parts_->matrices.stiffness({}, 1, w, z);
    }
}

template <int D, class Real>
std::uint64_t MassAndStiffness<D, Real>::heap() const {
    return parts_->stiffness ? parts_->stiffness->heap() : 0;
}

template <int D, class Real>
std::vector<Real> MassAndStiffness<D, Real>::lumped_mass() const {
    std::vector<Real> out(parts_->grid.count());
    parts_->matrices.lumped_mass(out);
    return out;
}

template <int D, class Real>
std::vector<Real> MassAndStiffness<D, Real>::stiffness_diagonal() const {
    std::vector<Real> out(parts_->grid.count());
    parts_->matrices.stiffness_diagonal({}, 1, out);
    return out;
}

template <class Real>
SolverResult conjugate_gradients(const LinearMap<Real>& product,
                                 const LinearMap<Real>& precondition, std::span<const Real> b,
                                 std::span<Real> x, const SolverOptions& options,
                                 Progress& progress) {
    const std::size_t n = x.size();
    if (b.size() != n || (!options.fixed.empty() && options.fixed.size() != n)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("vectors of different sizes: {} unknowns, {} values on the "
                                "right-hand side, {} flags of fixed ones",
                                n, b.size(), options.fixed.size()));
    }
    if (!(options.tolerance >= 0) || options.max_iterations < 0) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("a tolerance of {} or {} iterations: neither may be negative",
                                options.tolerance, options.max_iterations));
    }
    detail::Workers workers(options.threads);
    const std::uint8_t* const fixed = options.fixed.empty() ? nullptr : options.fixed.data();
    const auto is_free = [&](std::size_t i) { return fixed == nullptr || fixed[i] == 0; };
    const auto sum = [&](const auto& term) {
        return workers.execute([&] { return detail::sum_of(n, term); });
    };
    std::vector<Real> r(n);
    std::vector<Real> p(n);
    std::vector<Real> z(n);  // A p, then the preconditioned residual
    product(x, z);
    double squared = sum([&](std::size_t i) {
        r[i] = is_free(i) ? b[i] - z[i] : Real{0};
        return static_cast<double>(r[i]) * static_cast<double>(r[i]);
    });
    const double initial = std::sqrt(squared);
    SolverResult result;
    result.converged = initial == 0;
    double rho = 0;
    while (!result.converged && result.iterations < options.max_iterations) {
        progress.check();
        precondition(r, z);
        const double next = sum([&](std::size_t i) {
            z[i] = is_free(i) ? z[i] : Real{0};
            return static_cast<double>(r[i]) * static_cast<double>(z[i]);
        });
        const auto beta = static_cast<Real>(rho > 0 ? next / rho : 0);
        rho = next;
        workers.execute([&] {
            detail::for_parts(n, [&](std::size_t begin, std::size_t end) {
                for (std::size_t i = begin; i < end; ++i) {
                    p[i] = z[i] + beta * p[i];
                }
            });
        });
        product(p, z);
        const double curvature = sum([&](std::size_t i) {
            return is_free(i) ? static_cast<double>(p[i]) * static_cast<double>(z[i]) : 0.0;
        });
        if (!(curvature > 0) || !(rho > 0)) {
            break;  // the rest of r is rounding error
        }
        const auto alpha = static_cast<Real>(rho / curvature);
        squared = sum([&](std::size_t i) {
            x[i] += alpha * p[i];
            r[i] -= is_free(i) ? alpha * z[i] : Real{0};
            return static_cast<double>(r[i]) * static_cast<double>(r[i]);
        });
        ++result.iterations;
        result.converged = std::sqrt(squared) <= options.tolerance * initial;
    }
    result.residual = initial == 0 ? 0 : std::sqrt(squared) / initial;
    return result;
}

template class MassAndStiffness<1, float>;
template class MassAndStiffness<2, float>;
template class MassAndStiffness<3, float>;
template class MassAndStiffness<1, double>;
template class MassAndStiffness<2, double>;
template class MassAndStiffness<3, double>;
template SolverResult conjugate_gradients(const LinearMap<float>&, const LinearMap<float>&,
                                          std::span<const float>, std::span<float>,
                                          const SolverOptions&, Progress&);
template SolverResult conjugate_gradients(const LinearMap<double>&, const LinearMap<double>&,
                                          std::span<const double>, std::span<double>,
                                          const SolverOptions&, Progress&);

}  // namespace isonest
