// A mesh, cut into the cells of a level of detail.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include <isonest/int3.h>
#include <isonest/mesh_sink.h>

#include "query/simplify/block_files.h"
#include "store/base/vectors.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// The cells into which Neuroglancer's meshes are cut at a level of detail: their positions, and the
// order in which they are stored.

/// Interleaves the bits of the three numbers, x lowest: the position on the Z-curve. REQUIRES:
/// below 2^21.
inline std::uint64_t z_order(const Int3& cell) {
    std::uint64_t code = 0;
    for (unsigned bit = 0; bit < 21; ++bit) {
        for (int axis = 0; axis < 3; ++axis) {
            const auto set = static_cast<std::uint64_t>(cell[axis]) >> bit & 1U;
            code |= set << (3 * bit + static_cast<unsigned>(axis));
        }
    }
    return code;
}

/// Numbers the cells of a grid in the order of the Z-curve: its codes without unused bits, so there
/// are at most eight times as many numbers as cells.
class ZOrderedCells {
  public:
    /// With more bits, lists of all cells of a grid would be too large, even in a file.
    static constexpr int kMaxBits = 24;

    ZOrderedCells() = default;
    /// `cells`: along each axis, at least 1.
    explicit ZOrderedCells(const Int3& cells) {
        for (int axis = 0; axis < 3; ++axis) {
            bits_[static_cast<std::size_t>(axis)] =
                static_cast<int>(std::bit_width(static_cast<std::uint64_t>(cells[axis] - 1)));
        }
    }
    /// Number of bits of a cell number.
    [[nodiscard]] int bits() const { return bits_[0] + bits_[1] + bits_[2]; }

    [[nodiscard]] std::uint64_t number_of(const Int3& cell) const {
        std::uint64_t number = 0;
        each_bit([&](int axis, int bit, int place) {
            number |= (static_cast<std::uint64_t>(cell[axis]) >> bit & 1U) << place;
        });
        return number;
    }
    [[nodiscard]] Int3 cell_of(std::uint64_t number) const {
        Int3 cell;
        each_bit([&](int axis, int bit, int place) {
            cell[axis] |= static_cast<std::int64_t>((number >> place & 1U) << bit);
        });
        return cell;
    }

  private:
    template <class Visit>
    void each_bit(const Visit& visit) const {
        int place = 0;
        for (int bit = 0; place < bits(); ++bit) {
            for (int axis = 0; axis < 3; ++axis) {
                if (bit < bits_[static_cast<std::size_t>(axis)]) {
                    visit(axis, bit, place++);
                }
            }
        }
    }
    std::array<int, 3> bits_{};
};

/// Converts positions of a mesh to cells at a level of detail. Coordinates are in *strips*: from
/// one plane at which triangles are cut to the next. At level 0 a cell is one strip wide. Above it
/// is two, because it is drawn in eight parts, which are cells of the level below.
struct DetailGrid {
    Double3 origin{};        ///< of the volume, world units, in its own axes
    LatticeSteps steps;      ///< of its nodes
    Int3 first{};            ///< the first node of cell 0 0 0
    std::int64_t chunk = 1;  ///< nodes along a cell's edge at level 0; a power of two
    int level = 0;

    [[nodiscard]] int strips() const { return level == 0 ? 1 : 2; }
    /// Number of nodes along a cell's edge.
    [[nodiscard]] std::int64_t nodes() const { return chunk << level; }
    /// Monotone in each coordinate if the axes are at right angles. `position`: world units, in the
    /// volume's own axes; not before the first cell, apart from rounding.
    [[nodiscard]] Double3 strips_of(const std::array<float, 3>& position) const {
        const auto width = static_cast<double>(nodes()) / strips();
        const Double3 node = steps.steps_of({static_cast<double>(position[0]) - origin[0],
                                             static_cast<double>(position[1]) - origin[1],
                                             static_cast<double>(position[2]) - origin[2]});
        Double3 c{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const auto from = static_cast<double>(first[static_cast<int>(axis)]);
            c[axis] = std::max((node[axis] - from) / width, 0.0);
        }
        return c;
    }
};

/// The largest value of a rounded coordinate within a cell: 16 bits.
inline constexpr std::int32_t kMaxInCell = 65535;
inline constexpr int kBitsInCell = 16;

// Cuts triangles at planes of a grid, so that triangles with a common edge are cut at the same
// points.

/// A convex polygon in space: a triangle, or what is left of it after cutting.
class CutPolygon {
  public:
    /// Two planes of each axis add one corner each to a triangle; the rest allows for rounding.
    static constexpr std::size_t kMax = 16;

    CutPolygon() = default;
    CutPolygon(const Double3& a, const Double3& b, const Double3& c)
        : corners_{a, b, c}, size_(3) {}

    [[nodiscard]] std::size_t size() const { return size_; }
    const Double3& operator[](std::size_t i) const { return corners_[i]; }
    /// Does nothing if there is no room, which can only be caused by rounding.
    void add(const Double3& corner) {
        if (size_ < kMax) {
            corners_[size_++] = corner;
        }
    }
    /// The smallest and the largest coordinate.
    [[nodiscard]] std::array<double, 2> range(std::size_t axis) const {
        std::array<double, 2> r{corners_[0][axis], corners_[0][axis]};
        for (std::size_t i = 1; i < size_; ++i) {
            r[0] = std::min(r[0], corners_[i][axis]);
            r[1] = std::max(r[1], corners_[i][axis]);
        }
        return r;
    }

  private:
    std::array<Double3, kMax> corners_{};
    std::size_t size_ = 0;
};

/// The point where the edge from `below` to `above` meets the plane. It depends only on the ends,
/// not on the triangle; the coordinate along `axis` is exact.
inline Double3 meeting_point(const Double3& below, const Double3& above, std::size_t axis,
                             double plane) {
    const double t = (plane - below[axis]) / (above[axis] - below[axis]);
    Double3 p{};
    for (std::size_t i = 0; i < 3; ++i) {
        const auto [least, most] = std::minmax(below[i], above[i]);
        p[i] = std::clamp(below[i] + t * (above[i] - below[i]), least, most);
    }
    p[axis] = plane;
    return p;
}

/// The parts of the polygon below and above a plane that crosses it. The section by the plane is an
/// edge of both.
inline std::array<CutPolygon, 2> halves_of(const CutPolygon& polygon, std::size_t axis,
                                           double plane) {
    std::array<CutPolygon, 2> halves;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
        const Double3& from = polygon[i];
        const Double3& to = polygon[i + 1 < polygon.size() ? i + 1 : 0];
        const double d = from[axis] - plane;
        const double e = to[axis] - plane;
        if (d <= 0) {
            halves[0].add(from);
        }
        if (d >= 0) {
            halves[1].add(from);
        }
        if ((d < 0 && e > 0) || (d > 0 && e < 0)) {
            const Double3 p =
                d < 0 ? meeting_point(from, to, axis, plane) : meeting_point(to, from, axis, plane);
            halves[0].add(p);
            halves[1].add(p);
        }
    }
    return halves;
}

/// Calls `visit(strip, polygon)` with the parts of the polygon between planes at whole numbers,
/// along `axis` and the following ones: `strip` is the interval along each axis. Parts in a plane
/// belong to the strip below it. Coordinates are at least 0.
template <class Visit>
void cut_at_planes(const CutPolygon& polygon, std::size_t axis, Int3 strip, const Visit& visit) {
    if (axis == 3) {
        visit(strip, polygon);
        return;
    }
    CutPolygon rest = polygon;
    const auto [least, most] = polygon.range(axis);
    double at = std::floor(least);
    if (least == most && at == least) {
        at = std::max(at - 1, 0.0);
    }
    // Whole numbers, far below the limit of double.
    for (; at + 1 < most; ++at) {  // NOLINT(bugprone-float-loop-counter)
        const auto [below, above] = halves_of(rest, axis, at + 1);
        strip[static_cast<int>(axis)] = static_cast<std::int64_t>(at);
        cut_at_planes(below, axis + 1, strip, visit);
        rest = above;
    }
    strip[static_cast<int>(axis)] = static_cast<std::int64_t>(at);
    cut_at_planes(rest, axis + 1, strip, visit);
}

/// A position in a cell, from 0 to kMaxInCell along each axis.
using CellPoint = std::array<std::uint16_t, 3>;

/// A triangle within a cell.
struct CellTriangle {
    std::uint32_t block = 0;  ///< number of the cell
    std::array<CellPoint, 3> corners{};
};

/// A sink that cuts triangles at the planes of a grid (DetailGrid) and rounds corners to 1/65535 of
/// their cell's edges. Common corners of triangles with a common edge stay the same after rounding,
/// also in two cells. Triangles with two corners at the same place are omitted, as they are only
/// segments. Stored in temporary files. Thread-safety: one thread; constant data after end().
class CutMesh : public MeshSink {
  public:
    CutMesh(const DetailGrid& grid, const ScratchFolder& folder)
        : grid_(grid), triangles_(folder) {}

    /// Throws Error{limit} for more cells than can be numbered.
    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& /*batch*/) override {}
    void add_elements(const ElementBatch& batch) override;
    void end() override;

    // After end():

    [[nodiscard]] const DetailGrid& grid() const { return grid_; }
    /// Cell numbers are below this, in the order of the Z-curve; few cells have triangles.
    [[nodiscard]] std::uint32_t cells() const { return std::uint32_t{1} << order_.bits(); }
    [[nodiscard]] Int3 cell(std::uint32_t number) const { return order_.cell_of(number); }
    [[nodiscard]] std::span<const CellTriangle> of(std::uint32_t number) const {
        return triangles_.of(number);
    }
    /// Maximum number of triangles in a cell.
    [[nodiscard]] std::uint64_t largest() const;

  private:
    void add(const Int3& strip, const CutPolygon& polygon);

    DetailGrid grid_;
    ZOrderedCells order_;
    SortedByBlocks<CellTriangle> triangles_;
};

}  // namespace isonest::detail
