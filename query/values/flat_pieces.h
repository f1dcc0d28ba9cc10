// Triangles of the world in coordinates of the lattice, where they are flat.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "store/base/vectors.h"

namespace isonest::detail {

// With even axes, lattice coordinates are an affine function of the world's, so the image of a
// triangle is a triangle. Along an uneven axis they are affine only from each node to the next:
// there, a triangle is first cut at the nodes.

/// The part of a triangle between nodes of uneven axes: convex, so each of the six planes adds at
/// most one corner, apart from rounding.
struct FlatPiece {
    struct Corner {
        Double3 at;    ///< in own axes, relative to node 0
        double value;  ///< of a linear function on the triangle
    };
    static constexpr std::size_t kMax = 16;
    std::array<Corner, kMax> corner;
    std::size_t count = 0;

    void add(const Corner& c) {
        if (count < kMax) {
            corner[count++] = c;
        }
    }
};

/// Divides a piece at a plane across an axis. Corners in the plane belong to both parts.
inline std::array<FlatPiece, 2> divided(const FlatPiece& piece, std::size_t axis, double at) {
    std::array<FlatPiece, 2> parts;
    const FlatPiece::Corner* a = &piece.corner[piece.count - 1];
    for (std::size_t i = 0; i < piece.count; ++i) {
        const FlatPiece::Corner& b = piece.corner[i];
        const double from = a->at[axis] - at;
        const double to = b.at[axis] - at;
        if ((from < 0 && to > 0) || (from > 0 && to < 0)) {
            const double share = from / (from - to);
            const auto mean = [share](double x, double y) { return x + share * (y - x); };
            FlatPiece::Corner middle{
                {mean(a->at[0], b.at[0]), mean(a->at[1], b.at[1]), mean(a->at[2], b.at[2])},
                mean(a->value, b.value)};
            middle.at[axis] = at;
            parts[0].add(middle);
            parts[1].add(middle);
        }
        if (to <= 0) {
            parts[0].add(b);
        }
        if (to >= 0) {
            parts[1].add(b);
        }
        a = &b;
    }
    return parts;
}

/// for_each_flat_piece() for a piece that has been cut along the axes before `axis`.
template <class F>
bool for_each_flat_piece(const LatticeSteps& steps, const FlatPiece& piece, std::size_t axis,
                         const F& f) {
    while (axis < 3 && !steps.is_uneven(axis)) {
        ++axis;
    }
    if (axis == 3) {
        const auto& c = piece.corner;
        for (std::size_t i = 2; i < piece.count; ++i) {
            if (!f(std::array{steps.steps_of(c[0].at), steps.steps_of(c[i - 1].at),
                              steps.steps_of(c[i].at)},
                   std::array{c[0].value, c[i - 1].value, c[i].value})) {
                return false;
            }
        }
        return true;
    }
    double low = piece.corner[0].at[axis];
    double high = low;
    for (std::size_t i = 1; i < piece.count; ++i) {
        low = std::min(low, piece.corner[i].at[axis]);
        high = std::max(high, piece.corner[i].at[axis]);
    }
    // The first and the last interval extend beyond the volume.
    const std::vector<double>& nodes = steps.uneven->offsets[axis];
    auto node = std::upper_bound(nodes.begin() + 1, nodes.end() - 1, low);
    FlatPiece left = piece;
    for (; node != nodes.end() - 1 && *node < high; ++node) {
        const std::array<FlatPiece, 2> parts = divided(left, axis, *node);
        if (!for_each_flat_piece(steps, parts[0], axis + 1, f)) {
            return false;
        }
        left = parts[1];
    }
    return for_each_flat_piece(steps, left, axis + 1, f);
}

/// Divides the triangle `t` (in own axes, relative to node 0), with a linear function that has the
/// `values` at its corners, into triangles whose images in the lattice are flat. Calls
/// f(triangle in lattice coordinates, values at its corners) for each until f returns false; then
/// returns false. A triangle may be a segment or a point.
template <class F>
bool for_each_flat_piece(const LatticeSteps& steps, const std::array<Double3, 3>& t,
                         const std::array<double, 3>& values, const F& f) {
    if (steps.uneven == nullptr) {
        return f(std::array{steps.steps_of(t[0]), steps.steps_of(t[1]), steps.steps_of(t[2])},
                 values);
    }
    FlatPiece whole;
    for (std::size_t i = 0; i < 3; ++i) {
        whole.add({t[i], values[i]});
    }
    return for_each_flat_piece(steps, whole, 0, f);
}

/// By how much the rounding of a position can be larger in lattice coordinates than with even axes
/// of the same length.
inline double unevenness(const LatticeSteps& steps) {
    const Double3 least = steps.min_along();
    double most = 1;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        most = std::max(most, steps.along[axis] / least[axis]);
    }
    return most;
}

}  // namespace isonest::detail
