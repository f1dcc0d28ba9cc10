#include "query/simplify/proof/trilinear_cover.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace isonest::detail {
namespace {

/// 64 times the rounding of double.
constexpr double kEvaluation = 1e-14;

template <class Values>
double largest_of(const Values& values) {
    double most = 0;
    for (const double x : values) {
        most = std::max(most, std::fabs(x));
    }
    return most;
}

Double3 halfway(const Double3& a, const Double3& b) {
    return {(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2};
}

}  // namespace

const CellValues::Cube& CellValues::cube(const Int3& at) {
    constexpr unsigned kBits = 21;
    const auto key = static_cast<std::uint64_t>(at.x) | static_cast<std::uint64_t>(at.y) << kBits |
                     static_cast<std::uint64_t>(at.z) << (2 * kBits);
    if (key == recent_key_) {
        return cubes_[recent_];
    }
    auto slot = place_.find(key);
    if (slot == place_.end()) {
        if (cubes_.size() == kMax) {
            clear();
        }
        Cube& cube = cubes_.emplace_back();
        constexpr Int3 kCube{kEdge + 1, kEdge + 1, kEdge + 1};
        for (std::size_t i = 0; i < kNodes; ++i) {
            const Int3 node = at * kEdge + kCube.unlinear(static_cast<std::int64_t>(i));
            cube[i] = numbers_.value(min(node, last_), 0) - iso_;
        }
        slot = place_.emplace(key, static_cast<std::uint32_t>(cubes_.size() - 1)).first;
    }
    recent_key_ = key;
    recent_ = slot->second;
    return cubes_[recent_];
}

CellValues::Cell CellValues::cell(const Int3& at) {
    const Int3 of{at.x / kEdge, at.y / kEdge, at.z / kEdge};
    const Int3 in = at - of * kEdge;
    constexpr std::size_t kY = kEdge + 1;
    constexpr std::size_t kZ = kY * kY;
    const double* const u =
        &cube(of)[static_cast<std::size_t>((in.z * (kEdge + 1) + in.y) * (kEdge + 1) + in.x)];
    // Differences along x, then y, then z.
    const double x0 = u[1] - u[0];
    const double x1 = u[kY + 1] - u[kY];
    const double x2 = u[kZ + 1] - u[kZ];
    const double x3 = u[kZ + kY + 1] - u[kZ + kY];
    const double y0 = u[kY] - u[0];
    const double y2 = u[kZ + kY] - u[kZ];
    Cell c{};
    c.k0 = u[0];
    c.kx = x0;
    c.ky = y0;
    c.kz = u[kZ] - u[0];
    c.kxy = x1 - x0;
    c.kxz = x2 - x0;
    c.kyz = y2 - y0;
    c.kxyz = (x3 - x2) - (x1 - x0);
    c.size = std::fabs(c.k0) + std::fabs(c.kx) + std::fabs(c.ky) + std::fabs(c.kz) +
             std::fabs(c.kxy) + std::fabs(c.kxz) + std::fabs(c.kyz) + std::fabs(c.kxyz);
    return c;
}

void CellValues::clear() {
    cubes_.clear();
    place_.clear();
    recent_key_ = ~std::uint64_t{0};
}

TrilinearCover::TrilinearCover(GridNumbers& numbers, const WorldLattice& lattice, double iso,
                               double limit, int max_cuts)
    : numbers_(numbers),
      values_(numbers, lattice.nodes, iso),
      lattice_(lattice),
      limit_(limit),
      max_cuts_(max_cuts) {
    constexpr int kBits = 46;
    const std::int64_t longest = std::max({lattice.nodes.x, lattice.nodes.y, lattice.nodes.z});
    moved_ = unevenness(lattice.steps) * std::ldexp(static_cast<double>(longest), -kBits);
}

Double3 TrilinearCover::within_volume(Double3 p) const {
    for (std::size_t axis = 0; axis < 3; ++axis) {
        p[axis] = std::clamp(p[axis], 0.0,
                             static_cast<double>(lattice_.nodes[static_cast<int>(axis)] - 1));
    }
    return p;
}

/// The cell that starts at or before `x`; at the end of the volume the last one.
std::int64_t TrilinearCover::cell_below(double x, std::size_t axis) const {
    return std::min(static_cast<std::int64_t>(x), lattice_.nodes[static_cast<int>(axis)] - 2);
}

double TrilinearCover::value_at(const CellValues::Cell& k, const Double3& p) {
    return k.k0 + p[0] * (k.kx + p[1] * (k.kxy + p[2] * k.kxyz) + p[2] * k.kxz) +
           p[1] * (k.ky + p[2] * k.kyz) + p[2] * k.kz;
}

bool TrilinearCover::covers(const Triangle& t) {
    return ask(t);
}

double TrilinearCover::max_on(const Triangle& t) {
    constexpr int kCuts = 2;
    const double limit = limit_;
    const int max_cuts = max_cuts_;
    limit_ = std::numeric_limits<double>::max();
    min_cuts_ = max_cuts_ = kCuts;
    const bool is_known = ask(t);
    limit_ = limit;
    min_cuts_ = 0;
    max_cuts_ = max_cuts;
    return is_known ? largest_ : std::numeric_limits<double>::infinity();
}

bool TrilinearCover::misses(const Double3& p) {
    Double3 x = p;
    const CellValues::Cell k = values_.cell(cell_at(x));
    // A missing value is also a miss.
    return !(std::fabs(value_at(k, x)) <= limit_);
}

Int3 TrilinearCover::cell_at(Double3& p) const {
    p = within_volume(lattice_.position_of(p));
    const Int3 at{cell_below(p[0], 0), cell_below(p[1], 1), cell_below(p[2], 2)};
    p = {p[0] - static_cast<double>(at.x), p[1] - static_cast<double>(at.y),
         p[2] - static_cast<double>(at.z)};
    return at;
}

double TrilinearCover::slope(const Double3& p) {
    Double3 x = p;
    const Int3 at = cell_at(x);
    const CellValues::Cell k = values_.cell(at);
    Double3 along{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::int64_t low = at[static_cast<int>(axis)];
        along[axis] = lattice_.steps.between(axis, low, low + 1);
    }
    return length(lattice_.steps.gradient(
        {(k.kx + x[1] * k.kxy + x[2] * (k.kxz + x[1] * k.kxyz)) / along[0],
         (k.ky + x[0] * k.kxy + x[2] * (k.kyz + x[0] * k.kxyz)) / along[1],
         (k.kz + x[0] * k.kxz + x[1] * (k.kyz + x[0] * k.kxyz)) / along[2]}));
}

void TrilinearCover::rest() {
    values_.clear();
    numbers_.rest();
}

bool TrilinearCover::ask(const Triangle& t) {
    largest_ = 0;
    return lattice_.for_each_piece(t, [&](const Triangle& piece) {
        Polygon polygon;
        polygon.count = 3;
        for (std::size_t i = 0; i < 3; ++i) {
            polygon.corner[i] = within_volume(piece[i]);
        }
        Int3 cell;
        return ask_slabs(polygon, 2, cell);
    });
}

/// Processes slabs along an axis, then along the previous axes. `cell`: known along the later axes.
bool TrilinearCover::ask_slabs(const Polygon& polygon, std::size_t axis, Int3& cell) {
    double low = polygon.corner[0][axis];
    double high = low;
    for (std::size_t i = 1; i < polygon.count; ++i) {
        low = std::min(low, polygon.corner[i][axis]);
        high = std::max(high, polygon.corner[i][axis]);
    }
    const std::int64_t first = cell_below(low, axis);
    const std::int64_t last =
        std::max(first, std::min(static_cast<std::int64_t>(std::ceil(high)) - 1,
                                 lattice_.nodes[static_cast<int>(axis)] - 2));
    const auto ask_one = [&](const Polygon& part) {
        return axis == 0 ? inside(cell, part) : ask_slabs(part, axis - 1, cell);
    };
    if (first == last) {
        cell[static_cast<int>(axis)] = first;
        return ask_one(polygon);
    }
    std::array<Polygon, 2> rest;
    const Polygon* left = &polygon;
    Polygon part;
    for (std::int64_t i = first; i < last; ++i) {
        Polygon& above = rest[static_cast<std::size_t>(i - first) % 2];
        if (!cut(*left, axis, static_cast<double>(i + 1), part, above)) {
            return false;
        }
        cell[static_cast<int>(axis)] = i;
        if (part.count > 0 && !ask_one(part)) {
            return false;
        }
        left = &above;
    }
    cell[static_cast<int>(axis)] = last;
    return left->count == 0 || ask_one(*left);
}

/// Both parts have the same corners in the plane; every other corner belongs to one part. Returns
/// false if a part would have too many corners.
bool TrilinearCover::cut(const Polygon& polygon, std::size_t axis, double at, Polygon& below,
                         Polygon& above) {
    below.count = 0;
    above.count = 0;
    const Double3* a = &polygon.corner[polygon.count - 1];
    for (std::size_t i = 0; i < polygon.count; ++i) {
        if (std::max(below.count, above.count) + 2 > Polygon::kMax) {
            return false;
        }
        const Double3& b = polygon.corner[i];
        const double from = (*a)[axis] - at;
        const double to = b[axis] - at;
        if ((from < 0 && to > 0) || (from > 0 && to < 0)) {
            const double share = from / (from - to);
            Double3 c = along(*a, share, minus(b, *a));
            c[axis] = at;
            below.corner[below.count++] = c;
            above.corner[above.count++] = c;
        }
        if (to <= 0) {
            below.corner[below.count++] = b;
        }
        if (to >= 0) {
            above.corner[above.count++] = b;
        }
        a = &b;
    }
    return true;
}

bool TrilinearCover::inside(const Int3& at, const Polygon& polygon) {
    const CellValues::Cell cell = values_.cell(at);
    const auto local = [&](std::size_t i) -> Double3 {
        const Double3& p = polygon.corner[std::min(i, polygon.count - 1)];
        return {p[0] - static_cast<double>(at.x), p[1] - static_cast<double>(at.y),
                p[2] - static_cast<double>(at.z)};
    };
    Piece piece{local(0), local(1), local(2)};
    if (!inside(cell, piece, 0)) {
        return false;
    }
    for (std::size_t i = 3; i < polygon.count; ++i) {
        piece[1] = piece[2];
        piece[2] = local(i);
        if (!inside(cell, piece, 0)) {
            return false;
        }
    }
    return true;
}

bool TrilinearCover::inside(const CellValues::Cell& k, const Piece& piece, int cuts) {
    const auto& [a, b, c] = piece;
    // The blossom of a product is the mean over all assignments of the arguments to its factors.
    const auto two = [&](const Double3& p, const Double3& q) {
        return (k.kxy * (p[0] * q[1] + p[1] * q[0]) + k.kxz * (p[0] * q[2] + p[2] * q[0]) +
                k.kyz * (p[1] * q[2] + p[2] * q[1])) /
               6;
    };
    const auto one = [&](const Double3& p) {
        return (k.kx * p[0] + k.ky * p[1] + k.kz * p[2]) / 3;
    };
    const double third = k.kxyz / 3;
    /// p twice, q once.
    const auto three = [&](const Double3& p, const Double3& q) {
        return third * (p[0] * p[1] * q[2] + p[0] * q[1] * p[2] + q[0] * p[1] * p[2]);
    };
    const double la = one(a);
    const double lb = one(b);
    const double lc = one(c);
    const double aa = two(a, a);
    const double bb = two(b, b);
    const double cc = two(c, c);
    const double ab = two(a, b);
    const double bc = two(b, c);
    const double ca = two(c, a);
    const std::array corners{k.k0 + 3 * (la + aa) + three(a, a), k.k0 + 3 * (lb + bb) + three(b, b),
                             k.k0 + 3 * (lc + cc) + three(c, c)};
    const double slack = (4 * moved_ + kEvaluation) * k.size;
    const double met = largest_of(corners);
    // The size is NaN for a cell with a missing corner.
    if (!(k.size < std::numeric_limits<double>::infinity()) || met - slack > limit_) {
        return false;
    }
    const std::array others{
        k.k0 + 2 * la + lb + aa + 2 * ab + three(a, b),
        k.k0 + 2 * lb + la + bb + 2 * ab + three(b, a),
        k.k0 + 2 * lb + lc + bb + 2 * bc + three(b, c),
        k.k0 + 2 * lc + lb + cc + 2 * bc + three(c, b),
        k.k0 + 2 * lc + la + cc + 2 * ca + three(c, a),
        k.k0 + 2 * la + lc + aa + 2 * ca + three(a, c),
        k.k0 + la + lb + lc + ab + bc + ca +
            third / 2 *
                (a[0] * (b[1] * c[2] + c[1] * b[2]) + b[0] * (a[1] * c[2] + c[1] * a[2]) +
                 c[0] * (a[1] * b[2] + b[1] * a[2]))};
    const double bound = std::max(met, largest_of(others)) + slack;
    if (bound <= limit_ && cuts >= min_cuts_) {
        largest_ = std::max(largest_, bound);
        return true;
    }
    if (cuts >= max_cuts_) {
        return false;
    }
    // At the middles of the edges and of the piece.
    const std::array middles{(corners[0] + corners[1] + 3 * (others[0] + others[1])) / 8,
                             (corners[1] + corners[2] + 3 * (others[2] + others[3])) / 8,
                             (corners[2] + corners[0] + 3 * (others[4] + others[5])) / 8,
                             (corners[0] + corners[1] + corners[2] +
                              3 * (others[0] + others[1] + others[2] + others[3] + others[4] +
                                   others[5] + 2 * others[6])) /
                                 27};
    return largest_of(middles) - slack <= limit_ && quarters(k, piece, cuts + 1);
}

bool TrilinearCover::quarters(const CellValues::Cell& cell, const Piece& piece, int cuts) {
    const auto& [a, b, c] = piece;
    const Double3 ab = halfway(a, b);
    const Double3 bc = halfway(b, c);
    const Double3 ca = halfway(c, a);
    return inside(cell, {ab, bc, ca}, cuts) && inside(cell, {a, ab, ca}, cuts) &&
           inside(cell, {ab, b, bc}, cuts) && inside(cell, {ca, bc, c}, cuts);
}

}  // namespace isonest::detail
