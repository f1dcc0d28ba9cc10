// The product of the finest elements of a block, whole rows of cells at a time.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 7. A cell of the finest lattice has six
// elements, each a walk along three of its edges from the corner with even coordinates to the one
// with odd coordinates; so six gradients are computed from twelve differences, and the six local
// products from twelve fluxes along the edges. Elements exist only if the refinement node that
// creates them (the midpoint of a coarser cube's edge: the end of the walk's first step) is active;
// otherwise their weight is 0.
#pragma once

#include <array>
#include <cstddef>

namespace isonest::detail {

/// Number of cells per call: of equal parity along x, side by side.
inline constexpr std::size_t kCellsPerCall = 8;

/// One of the four rows of nodes at a row of cells: nodes with even and with odd x.
template <class Real>
struct NodeRow {
    const Real* even;
    const Real* odd;
};

/// The values at the corners of the cells: rows by the parities of y (1) and z (2).
template <class Real>
using CornerRows = std::array<NodeRow<Real>, 4>;

/// Constants of the local matrices.
template <class Real>
struct FinestTerms {
    Real volume;                  ///< of an element
    Real stiffness;               ///< factor of the stiffness matrix, times volume
    std::array<Real, 3> inverse;  ///< 1 / spacing^2
    Real inverse_lambda;          ///< 1 / lambda^2
};

/// Sums by corner: x parity 1, y parity 2, z parity 4.
template <class Real>
using CornerSums = std::array<std::array<Real, kCellsPerCall>, 8>;

/// The six elements' coefficients, by walk.
template <class Real>
struct WalkWeights {
    Real xyz, xzy, yxz, yzx, zxy, zyx;
};

/// The weights of the i-th cell: 0 for an element that does not exist, otherwise 1, or, with
/// `Coefficient`, 1 / (1 + |grad stopping|^2 / lambda^2).
template <bool Coefficient, class Real>
[[gnu::always_inline]] inline WalkWeights<Real> walk_weights(const FinestTerms<Real>& terms,
                                                             const CornerRows<Real>& stopping,
                                                             const CornerRows<Real>& active,
                                                             const Real* there, std::size_t i) {
    const auto [hx, hy, hz] = terms.inverse;
    const Real lambda = terms.inverse_lambda;
    Real xyz = active[0].odd[i] * there[i];
    Real yxz = active[1].even[i] * there[i];
    Real zxy = active[2].even[i] * there[i];
    Real xzy = xyz;
    Real yzx = yxz;
    Real zyx = zxy;
    if constexpr (Coefficient) {
        const auto square = [](Real a, Real b, Real h) { return (b - a) * (b - a) * h; };
        const auto& s = stopping;
        const Real x00 = square(s[0].even[i], s[0].odd[i], hx);
        const Real x10 = square(s[1].even[i], s[1].odd[i], hx);
        const Real x01 = square(s[2].even[i], s[2].odd[i], hx);
        const Real x11 = square(s[3].even[i], s[3].odd[i], hx);
        const Real y00 = square(s[0].even[i], s[1].even[i], hy);
        const Real y10 = square(s[0].odd[i], s[1].odd[i], hy);
        const Real y01 = square(s[2].even[i], s[3].even[i], hy);
        const Real y11 = square(s[2].odd[i], s[3].odd[i], hy);
        const Real z00 = square(s[0].even[i], s[2].even[i], hz);
        const Real z10 = square(s[0].odd[i], s[2].odd[i], hz);
        const Real z01 = square(s[1].even[i], s[3].even[i], hz);
        const Real z11 = square(s[1].odd[i], s[3].odd[i], hz);
        xyz /= 1 + (x00 + y10 + z11) * lambda;
        xzy /= 1 + (x00 + z10 + y11) * lambda;
        yxz /= 1 + (y00 + x10 + z11) * lambda;
        yzx /= 1 + (y00 + z01 + x11) * lambda;
        zxy /= 1 + (z00 + x01 + y11) * lambda;
        zyx /= 1 + (z00 + y01 + x11) * lambda;
    }
    return {xyz, xzy, yxz, yzx, zxy, zyx};
}

/// `Diagonal`: computes the stiffness matrix's diagonal instead of its product with value. `there`:
/// 1 where a cell is in the volume. Each lane's result depends only on that lane.
template <bool Coefficient, bool Diagonal, class Real>
[[gnu::always_inline]] inline void finest_stiffness(const FinestTerms<Real>& terms,
                                                    const CornerRows<Real>& value,
                                                    const CornerRows<Real>& stopping,
                                                    const CornerRows<Real>& active,
                                                    const Real* there, CornerSums<Real>& out) {
    const auto [hx, hy, hz] = terms.inverse;
    const Real scale = terms.stiffness;
    for (std::size_t i = 0; i < kCellsPerCall; ++i) {
        const auto [xyz, xzy, yxz, yzx, zxy, zyx] =
            walk_weights<Coefficient>(terms, stopping, active, there, i);
        const auto& w = value;
        const auto flux = [](Real weight, Real a, Real b) {
            return Diagonal ? weight : weight * (b - a);
        };
        const Real sx = hx * scale;
        const Real sy = hy * scale;
        const Real sz = hz * scale;
        const Real fx00 = flux((xyz + xzy) * sx, w[0].even[i], w[0].odd[i]);
        const Real fx10 = flux(yxz * sx, w[1].even[i], w[1].odd[i]);
        const Real fx01 = flux(zxy * sx, w[2].even[i], w[2].odd[i]);
        const Real fx11 = flux((yzx + zyx) * sx, w[3].even[i], w[3].odd[i]);
        const Real fy00 = flux((yxz + yzx) * sy, w[0].even[i], w[1].even[i]);
        const Real fy10 = flux(xyz * sy, w[0].odd[i], w[1].odd[i]);
        const Real fy01 = flux(zyx * sy, w[2].even[i], w[3].even[i]);
        const Real fy11 = flux((xzy + zxy) * sy, w[2].odd[i], w[3].odd[i]);
        const Real fz00 = flux((zxy + zyx) * sz, w[0].even[i], w[2].even[i]);
        const Real fz10 = flux(xzy * sz, w[0].odd[i], w[2].odd[i]);
        const Real fz01 = flux(yzx * sz, w[1].even[i], w[3].even[i]);
        const Real fz11 = flux((xyz + yxz) * sz, w[1].odd[i], w[3].odd[i]);
        constexpr Real kStart = Diagonal ? 1 : -1;
        out[0][i] = kStart * (fx00 + fy00 + fz00);
        out[1][i] = fx00 + kStart * (fy10 + fz10);
        out[2][i] = fy00 + kStart * (fx10 + fz01);
        out[3][i] = fx10 + fy10 + kStart * fz11;
        out[4][i] = fz00 + kStart * (fx01 + fy01);
        out[5][i] = fx01 + fz10 + kStart * fy11;
        out[6][i] = fy01 + fz01 + kStart * fx11;
        out[7][i] = fx11 + fy11 + fz11;
    }
}

/// out += the mass matrix times value or, with `Lumped`, its row sums.
template <bool Lumped, class Real>
[[gnu::always_inline]] inline void finest_mass(const FinestTerms<Real>& terms,
                                               const CornerRows<Real>& value,
                                               const CornerRows<Real>& active, const Real* there,
                                               CornerSums<Real>& out) {
    const Real quarter = terms.volume / 4;
    const Real part = terms.volume / 20;
    for (std::size_t i = 0; i < kCellsPerCall; ++i) {
        const Real x = active[0].odd[i] * there[i];
        const Real y = active[1].even[i] * there[i];
        const Real z = active[2].even[i] * there[i];
        const auto& w = value;
        if constexpr (Lumped) {
            out[0][i] += 2 * quarter * (x + y + z);
            out[1][i] += 2 * quarter * x;
            out[2][i] += 2 * quarter * y;
            out[4][i] += 2 * quarter * z;
            out[3][i] += quarter * (x + y);
            out[5][i] += quarter * (x + z);
            out[6][i] += quarter * (y + z);
            out[7][i] += 2 * quarter * (x + y + z);
        } else {
            const Real w0 = w[0].even[i];
            const Real w7 = w[3].odd[i];
            const Real both = w0 + w7;
            const Real xyz = x * (both + w[0].odd[i] + w[1].odd[i]);
            const Real xzy = x * (both + w[0].odd[i] + w[2].odd[i]);
            const Real yxz = y * (both + w[1].even[i] + w[1].odd[i]);
            const Real yzx = y * (both + w[1].even[i] + w[3].even[i]);
            const Real zxy = z * (both + w[2].even[i] + w[2].odd[i]);
            const Real zyx = z * (both + w[2].even[i] + w[3].even[i]);
            const Real all = xyz + xzy + yxz + yzx + zxy + zyx;
            const Real six = 2 * (x + y + z);
            out[0][i] += part * (all + six * w0);
            out[7][i] += part * (all + six * w7);
            out[1][i] += part * (xyz + xzy + 2 * x * w[0].odd[i]);
            out[2][i] += part * (yxz + yzx + 2 * y * w[1].even[i]);
            out[4][i] += part * (zxy + zyx + 2 * z * w[2].even[i]);
            out[3][i] += part * (xyz + yxz + (x + y) * w[1].odd[i]);
            out[5][i] += part * (xzy + zxy + (x + z) * w[2].odd[i]);
            out[6][i] += part * (yzx + zyx + (y + z) * w[3].even[i]);
        }
    }
}

/// Destination of the sums: the four rows of nodes, as in CornerRows.
template <class Real>
struct SumRow {
    Real* even;
    Real* odd;
};

/// What is summed at the elements' vertices.
enum class ElementWork {
    stiffness,           ///< factor times the stiffness matrix times the function
    stiffness_diagonal,  ///< factor times its diagonal
    lumped_mass,         ///< the row sums of the mass matrix
    consistent_mass      ///< its product with the function
};

/// Adds one call's cells to the sums.
template <ElementWork Work, bool Coefficient, class Real>
[[gnu::always_inline]] inline void add_finest(const FinestTerms<Real>& terms,
                                              const CornerRows<Real>& value,
                                              const CornerRows<Real>& stopping,
                                              const CornerRows<Real>& active, const Real* there,
                                              const std::array<SumRow<Real>, 4>& sums) {
    alignas(64) CornerSums<Real> out{};
    if constexpr (Work == ElementWork::stiffness) {
        finest_stiffness<Coefficient, false>(terms, value, stopping, active, there, out);
    } else if constexpr (Work == ElementWork::stiffness_diagonal) {
        finest_stiffness<Coefficient, true>(terms, value, stopping, active, there, out);
    } else {
        finest_mass<Work == ElementWork::lumped_mass>(terms, value, active, there, out);
    }
    for (std::size_t row = 0; row < 4; ++row) {
        for (std::size_t i = 0; i < kCellsPerCall; ++i) {
            sums[row].even[i] += out[2 * row][i];
        }
        for (std::size_t i = 0; i < kCellsPerCall; ++i) {
            sums[row].odd[i] += out[2 * row + 1][i];
        }
    }
}

/// Destination of the weights of the cells' twelve edges: along x, y and z, by the parities of the
/// other two axes in their order (1 and 2).
template <class Real>
using EdgeRows = std::array<std::array<Real*, 4>, 3>;

/// Adds the edges' weights (the negated entries of the stiffness matrix for their ends), and the
/// diagonal of the lumped mass matrix.
template <bool Coefficient, class Real>
[[gnu::always_inline]] inline void add_weights(const FinestTerms<Real>& terms,
                                               const CornerRows<Real>& stopping,
                                               const CornerRows<Real>& active, const Real* there,
                                               const EdgeRows<Real>& edges,
                                               const std::array<SumRow<Real>, 4>& mass) {
    const auto [hx, hy, hz] = terms.inverse;
    const Real sx = hx * terms.stiffness;
    const Real sy = hy * terms.stiffness;
    const Real sz = hz * terms.stiffness;
    alignas(64) std::array<std::array<std::array<Real, kCellsPerCall>, 4>, 3> out;
    for (std::size_t i = 0; i < kCellsPerCall; ++i) {
        const auto [xyz, xzy, yxz, yzx, zxy, zyx] =
            walk_weights<Coefficient>(terms, stopping, active, there, i);
        out[0][0][i] = (xyz + xzy) * sx;
        out[0][1][i] = yxz * sx;
        out[0][2][i] = zxy * sx;
        out[0][3][i] = (yzx + zyx) * sx;
        out[1][0][i] = (yxz + yzx) * sy;
        out[1][1][i] = xyz * sy;
        out[1][2][i] = zyx * sy;
        out[1][3][i] = (xzy + zxy) * sy;
        out[2][0][i] = (zxy + zyx) * sz;
        out[2][1][i] = xzy * sz;
        out[2][2][i] = yzx * sz;
        out[2][3][i] = (xyz + yxz) * sz;
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
        for (std::size_t row = 0; row < 4; ++row) {
            for (std::size_t i = 0; i < kCellsPerCall; ++i) {
                edges[axis][row][i] += out[axis][row][i];
            }
        }
    }
    add_finest<ElementWork::lumped_mass, false>(terms, stopping, stopping, active, there, mass);
}

/// The same, compiled for the machine's instruction set like the products below.
/// `with_coefficient`: Coefficient.
void add_finest_weights(bool with_coefficient, const FinestTerms<float>& terms,
                        const CornerRows<float>& stopping, const CornerRows<float>& active,
                        const float* there, const EdgeRows<float>& edges,
                        const std::array<SumRow<float>, 4>& mass);
inline void add_finest_weights(bool with_coefficient, const FinestTerms<double>& terms,
                               const CornerRows<double>& stopping, const CornerRows<double>& active,
                               const double* there, const EdgeRows<double>& edges,
                               const std::array<SumRow<double>, 4>& mass) {
    with_coefficient ? add_weights<true>(terms, stopping, active, there, edges, mass)
                     : add_weights<false>(terms, stopping, active, there, edges, mass);
}

/// The products, which take most of the time, compiled for the machine's instruction set.
void add_finest_products(const FinestTerms<float>& terms, const CornerRows<float>& value,
                         const CornerRows<float>& active, const float* there,
                         const std::array<SumRow<float>, 4>& sums);
void add_finest_products(const FinestTerms<float>& terms, const CornerRows<float>& value,
                         const CornerRows<float>& stopping, const CornerRows<float>& active,
                         const float* there, const std::array<SumRow<float>, 4>& sums);

}  // namespace isonest::detail
