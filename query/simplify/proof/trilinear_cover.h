// Whether the function that is trilinear on each cell stays near the isovalue on a triangle,
// proven.
//
// Each cell cuts a convex polygon out of the triangle, and a trilinear function on a triangle is a
// cubic polynomial: it lies between the smallest and the largest of its ten Bezier coefficients. If
// these are not conclusive, the piece is divided into four, whose coefficients are closer to the
// function. Source: G. Farin, "Curves and Surfaces for CAGD", 5th edition (2002), chapters 4
// (blossoms) and 17 (Bezier triangles).
#pragma once

#include <tsl/robin_map.h>

#include <array>
#include <cstdint>
#include <vector>

#include <isonest/int3.h>

#include "query/simplify/block_grid.h"
#include "query/simplify/proof/value_cover.h"
#include "store/base/box.h"

namespace isonest::detail {

/// Values of the finest lattice in small cubes that are loaded on demand. The number of cached
/// cubes is limited. Not thread-safe.
class CellValues {
  public:
    /// Cells along an edge of a cube.
    static constexpr std::int64_t kEdge = 4;
    static constexpr std::size_t kNodes = (kEdge + 1) * (kEdge + 1) * (kEdge + 1);
    /// Maximum number of cubes at a time.
    static constexpr std::size_t kMax = std::size_t{1} << 13U;
    /// While the table grows, both the old and the new table exist.
    static constexpr std::uint64_t kBytes = 2 * kMax * kNodes * sizeof(double);

    /// U minus the isovalue in a cell is k0 + x kx + y ky + z kz + x y kxy + x z kxz + y z kyz + x
    /// y z kxyz, for 0 <= x, y, z <= 1. NaN: a corner is missing.
    struct Cell {
        double k0, kx, ky, kz, kxy, kxz, kyz, kxyz;
        double size;  ///< sum of their absolute values
    };

    /// `numbers` must outlive this object. REQUIRES: at least two nodes along each axis.
    CellValues(GridNumbers& numbers, const Int3& nodes, double iso)
        : numbers_(numbers), last_(nodes - Int3{1, 1, 1}), iso_(iso) {}

    /// REQUIRES: the cell is in the volume.
    [[nodiscard]] Cell cell(const Int3& at);
    void clear();

  private:
    using Cube = std::array<double, kNodes>;
    const Cube& cube(const Int3& at);

    GridNumbers& numbers_;
    Int3 last_;  ///< node
    double iso_;
    std::vector<Cube> cubes_;
    tsl::robin_map<std::uint64_t, std::uint32_t, MixedHash> place_;
    std::uint64_t recent_key_ = ~std::uint64_t{0};
    std::uint32_t recent_ = 0;
};

/// Not thread-safe.
class TrilinearCover : public ValueProof {
  public:
    /// `limit`: in units of the data, > 0. `max_cuts`: maximum number of divisions of a piece
    /// before the answer is no. `numbers` must outlive this object. REQUIRES: at least two nodes
    /// along each axis.
    TrilinearCover(GridNumbers& numbers, const WorldLattice& lattice, double iso, double limit,
                   int max_cuts);

    /// Corners outside the volume are moved to its border; because of rounding, points of the
    /// triangle are moved by up to 2^-46 of the edge of a cube around the volume. Also returns
    /// false if values are missing, or if only rounding or a few more divisions could make it true.
    /// A triangle may be a segment or a point.
    [[nodiscard]] bool covers(const Triangle& t) override;
    [[nodiscard]] double largest() const override { return largest_; }
    [[nodiscard]] bool misses(const Double3& p) override;
    [[nodiscard]] double max_on(const Triangle& t) override;
    [[nodiscard]] double slope(const Double3& p) override;
    void rest() override;

  private:
    using Piece = std::array<Double3, 3>;
    /// The part of a triangle within planes: each plane adds at most one corner, apart from
    /// rounding.
    struct Polygon {
        static constexpr std::size_t kMax = 16;
        std::array<Double3, kMax> corner;
        std::size_t count = 0;
    };
    /// The cell at a point of the world; the point is converted to the cell's coordinates.
    [[nodiscard]] Int3 cell_at(Double3& p) const;
    /// The nearest point of the volume, both in lattice coordinates.
    [[nodiscard]] Double3 within_volume(Double3 p) const;
    [[nodiscard]] std::int64_t cell_below(double x, std::size_t axis) const;
    [[nodiscard]] static double value_at(const CellValues::Cell& cell, const Double3& p);
    [[nodiscard]] static bool cut(const Polygon& polygon, std::size_t axis, double at,
                                  Polygon& below, Polygon& above);
    bool ask(const Triangle& t);
    bool ask_slabs(const Polygon& polygon, std::size_t axis, Int3& cell);
    bool inside(const Int3& cell, const Polygon& polygon);
    bool inside(const CellValues::Cell& cell, const Piece& piece, int cuts);
    bool quarters(const CellValues::Cell& cell, const Piece& piece, int cuts);

    GridNumbers& numbers_;
    CellValues values_;
    WorldLattice lattice_;
    double limit_;
    int max_cuts_;
    int min_cuts_ = 0;  ///< minimum number of divisions of each piece, whatever the coefficients
                        ///< are
    double moved_;      ///< by how much rounding may move a point, in cells
    double largest_ = 0;
};

}  // namespace isonest::detail
