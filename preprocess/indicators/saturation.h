// Saturation: the indicator of a node covers those of its child refinement nodes.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5: bar(x) = max(eta(x), max bar(c)),
// plus(x) = eta(x) + max plus(c), over the child nodes c of all tetrahedra that share x: for a cube
// centre its six face centres, for a face centre its four edge midpoints, for an edge midpoint the
// centres of the eight finer cubes around it. Order: fine to coarse, edges, faces, centres.
#pragma once

#include <utility>
#include <vector>

#include "preprocess/indicators/layer.h"
#include "preprocess/indicators/row_kernels.h"

namespace isonest::detail {

/// bar: the maximum of a node and its children.
struct SaturateBar {
    template <class Real>
    Real operator()(Real own, Real children) const {
        return larger(own, children);
    }
    template <class Real>
    static void four(const Real* a, const Real* b, const Real* c, const Real* d, Real* out,
                     std::int64_t n) {
        raise_by_four(a, b, c, d, out, n);
    }
};

/// plus: the node added to the maximum of its children.
struct SaturatePlus {
    template <class Real>
    Real operator()(Real own, Real children) const {
        return own + children;
    }
    template <class Real>
    static void four(const Real* a, const Real* b, const Real* c, const Real* d, Real* out,
                     std::int64_t n) {
        add_largest_of_four(a, b, c, d, out, n);
    }
};

namespace saturation {

/// out[q] = the largest of four rows of finer centres: y0, y0 + 1 times z0, z0 + 1.
template <class Real>
void gather_centres(const Box<float>& centres, std::int64_t y0, std::int64_t z0,
                    std::vector<Real>& out) {
    const float* const a = centres.row(y0, z0);
    const float* const b = centres.row(y0 + 1, z0);
    const float* const c = centres.row(y0, z0 + 1);
    const float* const d = centres.row(y0 + 1, z0 + 1);
    out.resize(static_cast<std::size_t>(centres.size.x));
    for (std::size_t q = 0; q < out.size(); ++q) {
        out[q] = static_cast<Real>(larger(larger(a[q], b[q]), larger(c[q], d[q])));
    }
}

/// Combines n edges with the centres at distance `shift` and `shift + 1` in `children`.
template <class Op, class Real>
void apply_centres(Real* edges, std::int64_t n, const std::vector<Real>& children, int shift) {
    for (std::int64_t i = 0; i < n; ++i) {
        const auto q = static_cast<std::size_t>(2 * i + shift);
        edges[i] = Op{}(edges[i], larger(children[q], children[q + 1]));
    }
}

}  // namespace saturation

/// Saturates slots 0, 1, 2 of layer k in place. `centres` holds the saturated centre values of
/// level L-1, from cube 2 lo - 1 on (0 where there is no cube), or is null at level 1.
template <class Op, class Real>
void saturate_even_plane(const LayerRange& range, std::int64_t k, const Box<float>* centres,
                         Layer<Real>& layer) {
    constexpr int kEx = slot_of(1, 0, 0);
    constexpr int kEy = slot_of(0, 1, 0);
    std::vector<Real> children;
    if (centres != nullptr) {
        for (std::int64_t j = 0; j < range.count(1); ++j) {
            const std::int64_t y = 2 * (range.lo.y + j);
            saturation::gather_centres(*centres, y - 1, 2 * k - 1, children);
            saturation::apply_centres<Op>(layer.row(kEx, j), range.odd_count(0), children, 1);
            if (j < range.odd_count(1)) {
                saturation::gather_centres(*centres, y, 2 * k - 1, children);
                saturation::apply_centres<Op>(layer.row(kEy, j), range.count(0), children, 0);
            }
        }
    }
    for (std::int64_t j = 0; j < range.odd_count(1); ++j) {
        const Real* const ey = layer.row(kEy, j);
        Op::four(std::as_const(layer).row(kEx, j), std::as_const(layer).row(kEx, j + 1), ey, ey + 1,
                 layer.row(slot_of(1, 1, 0), j), range.odd_count(0));
    }
}

/// Saturates slots 3 to 6 of layer k in place; `layer` and `above` have saturated slots 0 to 2.
template <class Op, class Real>
void saturate_odd_plane(const LayerRange& range, std::int64_t k, const Box<float>* centres,
                        const Layer<Real>& above, Layer<Real>& layer) {
    constexpr int kEx = slot_of(1, 0, 0);
    constexpr int kEy = slot_of(0, 1, 0);
    constexpr int kEz = slot_of(0, 0, 1);
    constexpr int kFxy = slot_of(1, 1, 0);
    constexpr int kFxz = slot_of(1, 0, 1);
    constexpr int kFyz = slot_of(0, 1, 1);
    std::vector<Real> children;
    if (centres != nullptr) {
        for (std::int64_t j = 0; j < range.count(1); ++j) {
            saturation::gather_centres(*centres, 2 * (range.lo.y + j) - 1, 2 * k, children);
            saturation::apply_centres<Op>(layer.row(kEz, j), range.count(0), children, 0);
        }
    }
    for (std::int64_t j = 0; j < range.count(1); ++j) {
        const Real* const ez = layer.row(kEz, j);
        Op::four(ez, ez + 1, std::as_const(layer).row(kEx, j), above.row(kEx, j),
                 layer.row(kFxz, j), range.odd_count(0));
        if (j < range.odd_count(1)) {
            Op::four(ez, std::as_const(layer).row(kEz, j + 1), std::as_const(layer).row(kEy, j),
                     above.row(kEy, j), layer.row(kFyz, j), range.count(0));
        }
    }
    for (std::int64_t j = 0; j < range.odd_count(1); ++j) {
        Real* const c = layer.row(kCentreSlot, j);
        const Real* const fyz = layer.row(kFyz, j);
        const Real* const fxz = layer.row(kFxz, j);
        const Real* const fxz1 = layer.row(kFxz, j + 1);
        const Real* const fxy = layer.row(kFxy, j);
        const Real* const fxy1 = above.row(kFxy, j);
        for (std::int64_t i = 0; i < range.odd_count(0); ++i) {
            const Real x = larger(fyz[i], fyz[i + 1]);
            const Real y = larger(fxz[i], fxz1[i]);
            const Real z = larger(fxy[i], fxy1[i]);
            c[i] = Op{}(c[i], larger(larger(x, y), z));
        }
    }
}

}  // namespace isonest::detail
