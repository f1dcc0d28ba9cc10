// The offset indicator eta_infinity = |U(x) - (U(x1) + U(x2)) / 2| of every refinement node.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 4; x1, x2 are the ends of the refinement edge,
// whose direction alternates with the parity of the cube (section 2).
#pragma once

#include "preprocess/indicators/layer.h"
#include "preprocess/indicators/row_kernels.h"

namespace isonest::detail {

// `outward`: at least the exact offsets, see midpoint_offsets().

/// Nodes of the plane z = 2k: x and y edges, and xy faces (slots 0, 1, 2), of layer k.
template <class Real>
void linf_even_plane(const LayerRange& range, const SplitPlane<Real>& u, Layer<Real>& eta,
                     bool outward) {
    const std::int64_t nx = range.count(0);
    const std::int64_t nx1 = range.odd_count(0);
    for (std::int64_t j = 0; j < range.count(1); ++j) {
        const Real* const e0 = u.even(2 * j);
        midpoint_offsets(u.odd(2 * j), e0, e0 + 1, eta.row(slot_of(1, 0, 0), j), nx1, outward);
        if (j >= range.odd_count(1)) {
            continue;
        }
        const Real* const e2 = u.even(2 * j + 2);
        midpoint_offsets(u.even(2 * j + 1), e0, e2, eta.row(slot_of(0, 1, 0), j), nx, outward);
        diagonal_offsets(u.odd(2 * j + 1), e0, e2, range.lo.x + range.lo.y + j,
                         eta.row(slot_of(1, 1, 0), j), nx1, outward);
    }
}

/// Nodes of the plane z = 2k + 1: z edges, xz and yz faces, centres (slots 3 to 6), of layer k.
/// u0, u1, u2 are the planes 2k, 2k + 1, 2k + 2.
template <class Real>
void linf_odd_plane(const LayerRange& range, std::int64_t k, const SplitPlane<Real>& u0,
                    const SplitPlane<Real>& u1, const SplitPlane<Real>& u2, Layer<Real>& eta,
                    bool outward) {
    const std::int64_t nx = range.count(0);
    const std::int64_t nx1 = range.odd_count(0);
    const std::int64_t xz = range.lo.x + k;
    for (std::int64_t j = 0; j < range.count(1); ++j) {
        const std::int64_t y = 2 * j;
        midpoint_offsets(u1.even(y), u0.even(y), u2.even(y), eta.row(slot_of(0, 0, 1), j), nx,
                         outward);
        diagonal_offsets(u1.odd(y), u0.even(y), u2.even(y), xz, eta.row(slot_of(1, 0, 1), j), nx1,
                         outward);
        if (j >= range.odd_count(1)) {
            continue;
        }
        const bool yz_same = ((range.lo.y + j + k) & 1) == 0;
        // The rows at the two ends of the yz diagonal: (y, z) or (y + 2, z) below, the other above.
        const Real* const a = yz_same ? u0.even(y) : u0.even(y + 2);
        const Real* const b = yz_same ? u2.even(y + 2) : u2.even(y);
        midpoint_offsets(u1.even(y + 1), a, b, eta.row(slot_of(0, 1, 1), j), nx, outward);
        diagonal_offsets(u1.odd(y + 1), a, b, xz, eta.row(kCentreSlot, j), nx1, outward);
    }
}

}  // namespace isonest::detail
