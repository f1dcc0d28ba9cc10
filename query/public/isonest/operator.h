// Linear systems on implicit grids: z = A w without a stored matrix, and their solution.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 7:
//
//     SimplexAction(E) {
//         assemble local matrix on E;
//         compute local matrix vector product;
//         for all x in N(E): update z(x);
//     }
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include <isonest/implicit_grid.h>
#include <isonest/progress.h>

namespace isonest {
namespace detail {
template <int D, class Real>
struct MassAndStiffnessParts;
template <int D, class Real>
struct MultilevelParts;
}  // namespace detail

/// A local matrix. With several unknowns per node, unknown k of vertex i has index i * unknowns +
/// k.
template <class Real, int N>
using LocalMatrix =
    std::array<std::array<Real, static_cast<std::size_t>(N)>, static_cast<std::size_t>(N)>;

/// Integrals of a * grad phi_i . grad phi_j over an element.
template <class Real = double, int D>
LocalMatrix<Real, D + 1> stiffness_matrix(const ElementShape<D>& shape, double a = 1) {
    LocalMatrix<Real, D + 1> m;
    for (std::size_t i = 0; i <= D; ++i) {
        for (std::size_t j = 0; j <= D; ++j) {
            const Double3& g = shape.gradient[i];
            const Double3& h = shape.gradient[j];
            m[i][j] =
                static_cast<Real>(a * shape.measure * (g[0] * h[0] + g[1] * h[1] + g[2] * h[2]));
        }
    }
    return m;
}

/// Integrals of c * phi_i phi_j over an element.
template <class Real = double, int D>
LocalMatrix<Real, D + 1> mass_matrix(const ElementShape<D>& shape, double c = 1) {
    const double part = c * shape.measure / ((D + 1) * (D + 2));
    LocalMatrix<Real, D + 1> m;
    for (std::size_t i = 0; i <= D; ++i) {
        m[i].fill(static_cast<Real>(part));
        m[i][i] = static_cast<Real>(2 * part);
    }
    return m;
}

/// A product z = A w, or a preconditioner. Vectors have one number for each unknown: unknown k of
/// node n has index n * unknowns + k.
template <class Real>
using LinearMap = std::function<void(std::span<const Real> w, std::span<Real> z)>;

/// z = A w with the caller's local matrices: local(const GridElement<D>&) returns the element's
/// LocalMatrix<Real, (D + 1) * Unknowns>; it is called in every product, from many threads. Nodal
/// data are read by the numbers in GridElement::node. Holds a copy of the grid and of `local`.
template <class Real, int Unknowns, int D, class Local>
class LocalOperator {
  public:
    static constexpr std::size_t kSize = (static_cast<std::size_t>(D) + 1) * Unknowns;

    LocalOperator(const ImplicitGrid<D>& grid, Local local)
        : grid_(grid), local_(std::move(local)) {}

    /// Number of unknowns.
    [[nodiscard]] std::size_t size() const { return grid_.count() * Unknowns; }
    void operator()(std::span<const Real> w, std::span<Real> z) const {
        std::fill(z.begin(), z.end(), Real{0});
        grid_.for_each_element([&](const GridElement<D>& t) { add(t, w, z); });
    }
    /// The same by the hash table, in one thread. REQUIRES: it has numbered this grid, and nothing
    /// else; w and z have numbering.count() * Unknowns numbers.
    void operator()(HashedNumbering& numbering, std::span<const Real> w, std::span<Real> z) const {
        std::fill(z.begin(), z.end(), Real{0});
        grid_.for_each_element(numbering, [&](const GridElement<D>& t) { add(t, w, z); });
    }
    /// The diagonal of A.
    [[nodiscard]] std::vector<Real> diagonal() const {
        std::vector<Real> d(size());
        grid_.for_each_element([&](const GridElement<D>& t) {
            const LocalMatrix<Real, static_cast<int>(kSize)> m = local_(t);
            for (std::size_t i = 0; i < kSize; ++i) {
                d[index(t, i)] += m[i][i];
            }
        });
        return d;
    }

  private:
    static std::size_t index(const GridElement<D>& t, std::size_t i) {
        return static_cast<std::size_t>(t.node[i / Unknowns]) * Unknowns + i % Unknowns;
    }
    void add(const GridElement<D>& t, std::span<const Real> w, std::span<Real> z) const {
        const LocalMatrix<Real, static_cast<int>(kSize)> m = local_(t);
        std::array<Real, kSize> value;
        for (std::size_t i = 0; i < kSize; ++i) {
            value[i] = w[index(t, i)];
        }
        for (std::size_t i = 0; i < kSize; ++i) {
            Real sum = m[i][0] * value[0];
            for (std::size_t j = 1; j < kSize; ++j) {
                sum += m[i][j] * value[j];
            }
            z[index(t, i)] += sum;
        }
    }

    ImplicitGrid<D> grid_;
    Local local_;
};

/// local_operator<double>(grid, local), local_operator<float, 2>(grid, local).
template <class Real, int Unknowns = 1, int D, class Local>
LocalOperator<Real, Unknowns, D, Local> local_operator(const ImplicitGrid<D>& grid, Local local) {
    return {grid, std::move(local)};
}

/// The mass matrix M (integrals of phi_i phi_j) and the stiffness matrix B (integrals of grad phi_i
/// . grad phi_j), multiplied block by block (query/COMPUTING.md). Neither is stored if all nodes of
/// the lattice are active; otherwise B is stored as weights of the grid's edges. Copies share their
/// data. Thread-safety: one thread for all copies.
template <int D, class Real>
class MassAndStiffness {
  public:
    explicit MassAndStiffness(const ImplicitGrid<D>& grid);

    /// z = M w.
    void mass(std::span<const Real> w, std::span<Real> z) const;
    /// z = B w.
    void stiffness(std::span<const Real> w, std::span<Real> z) const;
    /// The sums of M's rows.
    [[nodiscard]] std::vector<Real> lumped_mass() const;
    /// The diagonal of B. That of M is 2 / (D + 2) times the lumped mass.
    [[nodiscard]] std::vector<Real> stiffness_diagonal() const;
    /// Size in bytes of the stored matrix; 0 if there is none.
    [[nodiscard]] std::uint64_t heap() const;

  private:
    std::shared_ptr<detail::MassAndStiffnessParts<D, Real>> parts_;
};

/// Jacobi's preconditioner: divides by the diagonal of the matrix. REQUIRES: it is positive.
template <class Real>
class Jacobi {
  public:
    explicit Jacobi(std::vector<Real> diagonal) : diagonal_(std::move(diagonal)) {}
    void operator()(std::span<const Real> r, std::span<Real> z) const {
        for (std::size_t i = 0; i < z.size(); ++i) {
            z[i] = r[i] / diagonal_[i];
        }
    }

  private:
    std::vector<Real> diagonal_;
};

struct MultilevelOptions {
    /// The matrix is like stiffness * B + mass * M. Constant factors do not matter; at least one is
    /// positive, none negative.
    double stiffness = 1;
    double mass = 0;
    int unknowns = 1;  ///< per node; each gets the same preconditioner
    /// 1 for each unknown whose value is fixed; empty if none is.
    std::span<const std::uint8_t> fixed = {};
};

/// The multilevel preconditioner of Bramble, Pasciak and Xu on the nested grid:
///
///     z = sum over the levels l and their nodes i:  phi_i^l (r, phi_i^l) / a(phi_i^l, phi_i^l)
///
/// phi_i^l is the function of node i in the grid whose elements are refined to level l at most. The
/// sum contains each different function once: those of the nodes that are new in a level, and of
/// the ends of their refinement edges. Functions that are not 0 at a fixed unknown are left out.
/// The preconditioner is symmetric and positive definite; the number of iterations does not grow
/// with the number of levels if the fixed nodes are whole faces of the box, or none are.
///
/// Source: J. Bramble, J. Pasciak, J. Xu, "Parallel multilevel preconditioners", Math. Comp. 55
/// (1990); for locally refined grids W. Dahmen, A. Kunoth, "Multilevel preconditioning", Numer.
/// Math. 63 (1992).
///
/// Memory: a number of type Real per unknown, and for each coarser level 12 bytes for 64 nodes of
/// its lattice and three numbers per node and unknown. Copies share their data. Thread-safety: one
/// thread for all copies.
template <int D, class Real>
class Multilevel {
  public:
    /// `diagonal`: of the matrix, if its coefficients vary: each function's a(phi, phi) is scaled
    /// by the mean ratio of this diagonal to that of the options' matrix. Throws
    /// Error{invalid_argument} for options out of range or another number of unknowns,
    /// Error{limit}.
    explicit Multilevel(const ImplicitGrid<D>& grid, const MultilevelOptions& options = {},
                        std::span<const Real> diagonal = {});
    void operator()(std::span<const Real> r, std::span<Real> z) const;
    /// Size in bytes.
    [[nodiscard]] std::uint64_t heap() const;

  private:
    std::shared_ptr<detail::MultilevelParts<D, Real>> parts_;
};

struct SolverOptions {
    double tolerance = 1e-8;  ///< of the residual's Euclidean norm, relative to its initial one
    int max_iterations = 1000;
    int threads = 0;  ///< for operations on vectors; 0 = all
    /// 1 for each unknown that keeps its initial value; empty if none does.
    std::span<const std::uint8_t> fixed = {};
};

struct SolverResult {
    int iterations = 0;
    double residual = 0;  ///< as SolverOptions::tolerance
    bool converged = false;
};

/// Solves A x = b at the unknowns that are not fixed. `x`: the initial values, then the solution.
/// REQUIRES: A and the preconditioner are symmetric, and positive definite on the unknowns that are
/// not fixed; x, b and the options' `fixed` have one number per unknown. Takes three vectors. The
/// result is the same for any number of threads if those of the functions are. Throws what they
/// throw, Error{invalid_argument} for vectors of different sizes or options out of range, and
/// Error{cancelled}.
///
/// Source: Y. Saad, "Iterative methods for sparse linear systems" (2003), algorithm 9.1.
template <class Real>
SolverResult conjugate_gradients(const LinearMap<Real>& product,
                                 const LinearMap<Real>& precondition, std::span<const Real> b,
                                 std::span<Real> x, const SolverOptions& options = {},
                                 Progress& progress = silent_progress());

extern template class MassAndStiffness<1, float>;
extern template class MassAndStiffness<2, float>;
extern template class MassAndStiffness<3, float>;
extern template class MassAndStiffness<1, double>;
extern template class MassAndStiffness<2, double>;
extern template class MassAndStiffness<3, double>;
extern template class Multilevel<1, float>;
extern template class Multilevel<2, float>;
extern template class Multilevel<3, float>;
extern template class Multilevel<1, double>;
extern template class Multilevel<2, double>;
extern template class Multilevel<3, double>;
extern template SolverResult conjugate_gradients(const LinearMap<float>&, const LinearMap<float>&,
                                                 std::span<const float>, std::span<float>,
                                                 const SolverOptions&, Progress&);
extern template SolverResult conjugate_gradients(const LinearMap<double>&, const LinearMap<double>&,
                                                 std::span<const double>, std::span<double>,
                                                 const SolverOptions&, Progress&);

}  // namespace isonest
