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

#include "query/mesh/cut_polygon.h"
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
    void add(const Int3& strip, const CutPolygon<Double3>& polygon);

    DetailGrid grid_;
    ZOrderedCells order_;
    SortedByBlocks<CellTriangle> triangles_;
};

}  // namespace isonest::detail
