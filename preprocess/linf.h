// The offset indicator eta_infinity = |U(x) - (U(x1) + U(x2)) / 2| of every refinement node.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 3; x1, x2 are the ends of the refinement edge,
// whose direction alternates with the parity of the cube (section 2).
#pragma once

#include <cmath>

#include "preprocess/layer.h"

namespace isonest {

/// Nodes of the plane z = 2k: x and y edges, and xy faces (slots 0, 1, 2), of layer k.
template <class Real>
void linf_even_plane(const LayerRange& range, const SplitPlane<Real>& u, Layer<Real>& eta) {
    const std::int64_t nx = range.count(0);
    const std::int64_t nx1 = range.odd_count(0);
    const Real half{0.5};
    for (std::int64_t j = 0; j < range.count(1); ++j) {
        const Real* const e0 = u.even(2 * j);
        const Real* const o0 = u.odd(2 * j);
        Real* const ex = eta.row(slot_of(1, 0, 0), j);
        for (std::int64_t i = 0; i < nx1; ++i) {
            ex[i] = std::fabs(o0[i] - half * (e0[i] + e0[i + 1]));
        }
        if (j >= range.odd_count(1)) {
            continue;
        }
        const Real* const e1 = u.even(2 * j + 1);
        const Real* const o1 = u.odd(2 * j + 1);
        const Real* const e2 = u.even(2 * j + 2);
        Real* const ey = eta.row(slot_of(0, 1, 0), j);
        for (std::int64_t i = 0; i < nx; ++i) {
            ey[i] = std::fabs(e1[i] - half * (e0[i] + e2[i]));
        }
        Real* const f = eta.row(slot_of(1, 1, 0), j);
        const std::int64_t parity = range.lo.x + range.lo.y + j;
        for (std::int64_t i = 0; i < nx1; ++i) {
            const Real same = e0[i] + e2[i + 1];
            const Real cross = e0[i + 1] + e2[i];
            f[i] = std::fabs(o1[i] - half * (((parity + i) & 1) == 0 ? same : cross));
        }
    }
}

/// Nodes of the plane z = 2k + 1: z edges, xz and yz faces, centres (slots 3 to 6), of layer k.
/// u0, u1, u2 are the planes 2k, 2k + 1, 2k + 2.
template <class Real>
void linf_odd_plane(const LayerRange& range, std::int64_t k, const SplitPlane<Real>& u0,
                    const SplitPlane<Real>& u1, const SplitPlane<Real>& u2, Layer<Real>& eta) {
    const std::int64_t nx = range.count(0);
    const std::int64_t nx1 = range.odd_count(0);
    const Real half{0.5};
    for (std::int64_t j = 0; j < range.count(1); ++j) {
        const std::int64_t y = 2 * j;
        const Real* const low = u0.even(y);
        const Real* const high = u2.even(y);
        const Real* const mid = u1.even(y);
        Real* const ez = eta.row(slot_of(0, 0, 1), j);
        for (std::int64_t i = 0; i < nx; ++i) {
            ez[i] = std::fabs(mid[i] - half * (low[i] + high[i]));
        }
        const Real* const mid_odd = u1.odd(y);
        Real* const fxz = eta.row(slot_of(1, 0, 1), j);
        const std::int64_t xz = range.lo.x + k;
        for (std::int64_t i = 0; i < nx1; ++i) {
            const Real same = low[i] + high[i + 1];
            const Real cross = low[i + 1] + high[i];
            fxz[i] = std::fabs(mid_odd[i] - half * (((xz + i) & 1) == 0 ? same : cross));
        }
        if (j >= range.odd_count(1)) {
            continue;
        }
        const bool yz_same = ((range.lo.y + j + k) & 1) == 0;
        // The rows at the two ends of the yz diagonal: (y, z) or (y + 2, z) below, the other above.
        const Real* const a = yz_same ? u0.even(y) : u0.even(y + 2);
        const Real* const b = yz_same ? u2.even(y + 2) : u2.even(y);
        const Real* const c1 = u1.even(y + 1);
        Real* const fyz = eta.row(slot_of(0, 1, 1), j);
        for (std::int64_t i = 0; i < nx; ++i) {
            fyz[i] = std::fabs(c1[i] - half * (a[i] + b[i]));
        }
        const Real* const o1 = u1.odd(y + 1);
        Real* const centre = eta.row(kCentreSlot, j);
        for (std::int64_t i = 0; i < nx1; ++i) {
            const Real same = a[i] + b[i + 1];
            const Real cross = a[i + 1] + b[i];
            centre[i] = std::fabs(o1[i] - half * (((xz + i) & 1) == 0 ? same : cross));
        }
    }
}

}  // namespace isonest
