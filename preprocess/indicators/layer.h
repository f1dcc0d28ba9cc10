// One layer of refinement nodes and computations on it: offsets, missing data, saturation.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "preprocess/indicators/row_kernels.h"
#include "store/base/box.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

// One layer of refinement nodes: those that belong to the lattice nodes of level L in one z-plane.

/// The part of level L that a kernel works on: lattice nodes lo..hi inclusive. hi is one past the
/// nodes to be produced, unless the volume ends there.
struct LayerRange {
    Int3 lo;
    Int3 hi;
    Int3 cells;  ///< cubes of the level per axis

    [[nodiscard]] std::int64_t count(int axis) const { return hi[axis] - lo[axis] + 1; }
    /// Number of lattice nodes whose nodes at an odd offset along `axis` can be computed here.
    [[nodiscard]] std::int64_t odd_count(int axis) const {
        return std::min(hi[axis], cells[axis]) - lo[axis];
    }
    [[nodiscard]] std::int64_t count(int axis, int offset) const {
        return offset == 0 ? count(axis) : odd_count(axis);
    }
};

/// Calls f(slot, i, j) for every node of slots first to last of a layer that can be computed here;
/// its owner is the lattice node lo + (i, j).
template <class F>
void each_node(const LayerRange& range, int first, int last, const F& f) {
    for (int slot = first; slot <= last; ++slot) {
        const Int3 o = slot_offset(slot);
        for (std::int64_t j = 0; j < range.count(1, static_cast<int>(o.y)); ++j) {
            for (std::int64_t i = 0; i < range.count(0, static_cast<int>(o.x)); ++i) {
                f(slot, i, j);
            }
        }
    }
}

/// Seven arrays [y][x] of one layer; each row is followed by one spare element.
template <class Real>
class Layer {
  public:
    Layer() = default;
    Layer(std::int64_t nx, std::int64_t ny)
        : pitch_(nx + 1),
          data_(static_cast<std::size_t>(kSlots * pitch_ * (ny + 1))),
          rows_(ny + 1) {}
    [[nodiscard]] Real* row(int slot, std::int64_t y) {
        return data_.data() + (slot * rows_ + y) * pitch_;
    }
    [[nodiscard]] const Real* row(int slot, std::int64_t y) const {
        return data_.data() + (slot * rows_ + y) * pitch_;
    }
    void clear() { std::fill(data_.begin(), data_.end(), Real{0}); }

  private:
    std::int64_t pitch_ = 0;
    std::vector<Real> data_;
    std::int64_t rows_ = 0;
};

/// Values of one plane of the lattice of stride 2^(L-1), with rows split by the parity of x:
/// even(y)[i] = U(2 (lo.x + i), y), odd(y)[i] = U(2 (lo.x + i) + 1, y), where y counts from 2 lo.y.
template <class Real>
class SplitPlane {
  public:
    SplitPlane() = default;
    explicit SplitPlane(const LayerRange& range)
        : pitch_(range.count(0) + 1),
          rows_(2 * range.count(1) - 1),
          data_(static_cast<std::size_t>(2 * pitch_ * rows_)) {}
    [[nodiscard]] Real* even(std::int64_t y) { return data_.data() + 2 * y * pitch_; }
    [[nodiscard]] Real* odd(std::int64_t y) { return data_.data() + (2 * y + 1) * pitch_; }
    [[nodiscard]] const Real* even(std::int64_t y) const { return data_.data() + 2 * y * pitch_; }
    [[nodiscard]] const Real* odd(std::int64_t y) const {
        return data_.data() + (2 * y + 1) * pitch_;
    }
    [[nodiscard]] std::int64_t pitch() const { return pitch_; }
    [[nodiscard]] std::int64_t rows() const { return rows_; }

  private:
    std::int64_t pitch_ = 0;
    std::int64_t rows_ = 0;
    std::vector<Real> data_;
};

// The offset indicator eta_infinity = |U(x) - (U(x1) + U(x2)) / 2| of every refinement node.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 4; x1, x2 are the ends of the refinement edge,
// whose direction alternates with the parity of the cube (section 2). `outward`: the results are at
// least the exact offsets, see midpoint_offsets().

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

// Missing data: a node whose diamond contains a non-finite value is always refined.

/// Which nodes of a box are missing (1) or not (0).
using MissingBox = Box<std::uint8_t>;

/// Level 1: sets eta to +inf if the node or an end of its refinement edge is missing. This is
/// sufficient, because the rest of a diamond consists of cells of the finest level. `missing` as
/// below.
template <class Real>
void mark_missing_finest(const LayerRange& range, std::int64_t k, int first_slot, int last_slot,
                         const MissingBox& missing, Layer<Real>& eta) {
    each_node(range, first_slot, last_slot, [&](int slot, std::int64_t i, std::int64_t j) {
        const Int3 p = Int3{range.lo.x + i, range.lo.y + j, k} * 2 + slot_offset(slot);
        const NodeInfo node = describe_node(p, 1);
        if (missing.at(p) != 0 || missing.at(node.end0) != 0 || missing.at(node.end1) != 0) {
            eta.row(slot, j)[i] = std::numeric_limits<Real>::infinity();
        }
    });
}

/// Sets eta to +inf if the node, or a vertex of a tetrahedron that refines at it, is missing.
/// `missing` covers the lattice of stride 2^(L-1) from 2 lo - 1 to 2 hi + 1.
template <class Real>
void mark_missing(const LayerRange& range, std::int64_t k, int first_slot, int last_slot,
                  const MissingBox& missing, Layer<Real>& eta) {
    const auto is_missing = [&](const Int3& p) {
        const Int3 last = missing.lo + missing.size - Int3{1, 1, 1};
        return missing.at(max(missing.lo, min(p, last))) != 0;
    };
    // The vertices of the diamond: for a centre the corners of the cube; for a face its corners and
    // the two centres; for an edge its ends, and the faces and centres around it.
    each_node(range, first_slot, last_slot, [&](int slot, std::int64_t i, std::int64_t j) {
        const Int3 o = slot_offset(slot);
        const std::int64_t odd = o.x + o.y + o.z;
        const Int3 p = Int3{range.lo.x + i, range.lo.y + j, k} * 2 + o;
        bool found = false;
        for (std::int64_t d = 0; d < 27 && !found; ++d) {
            const Int3 e = (Int3{3, 3, 3}).unlinear(d) - Int3{1, 1, 1};
            std::int64_t along = 0;
            std::int64_t across = 0;
            for (int axis = 0; axis < 3; ++axis) {
                (o[axis] != 0 ? along : across) += e[axis] != 0 ? 1 : 0;
            }
            const bool vertex = (along == odd && across == 0) || along == 0;
            found = vertex && is_missing(p + e);
        }
        if (found) {
            eta.row(slot, j)[i] = std::numeric_limits<Real>::infinity();
        }
    });
}

// Saturation: the indicator of a node covers those of its child refinement nodes.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5: bar(x) = max(eta(x), max bar(c)),
// plus(x) = eta(x) + max plus(c), over the child nodes c of all tetrahedra that share x: for a cube
// centre its six face centres, for a face centre its four edge midpoints, for an edge midpoint the
// centres of the eight finer cubes around it. Order: fine to coarse, edges, faces, centres.

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

/// plus: the sum of a node and the maximum of its children.
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

/// out[q] = the maximum over four rows of finer centres: y0, y0 + 1 times z0, z0 + 1.
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

/// Combines n edges with the centres in `children` at distances `shift` and `shift + 1`.
template <class Op, class Real>
void apply_centres(Real* edges, std::int64_t n, const std::vector<Real>& children, int shift) {
    for (std::int64_t i = 0; i < n; ++i) {
        const auto q = static_cast<std::size_t>(2 * i + shift);
        edges[i] = Op{}(edges[i], larger(children[q], children[q + 1]));
    }
}

}  // namespace saturation

/// Saturates slots 0, 1, 2 of layer k in place. `centres` contains the saturated centre values of
/// level L-1, starting at cube 2 lo - 1 (0 if there is no cube); null at level 1.
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

/// Saturates slots 3 to 6 of layer k in place. REQUIRES: slots 0 to 2 of `layer` and `above` are
/// saturated.
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
