// A mesh, cut into the cells of a level of detail.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include <isonest/mesh_sink.h>

#include "query/neuroglancer/cut_polygon.h"
#include "query/neuroglancer/detail_grid.h"
#include "query/simplify/block_triangles.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// A place in a cell, from 0 to kMostInCell along each axis.
using CellPoint = std::array<std::uint16_t, 3>;

/// A triangle within a cell.
struct CellTriangle {
    std::uint32_t block = 0;  ///< number of the cell
    std::array<CellPoint, 3> corners{};
};

/// A sink that cuts triangles at the planes of a grid (DetailGrid) and rounds corners to 1/65535 of
/// their cell's edges. Rounded corners of triangles with a common edge stay the same ones, also in
/// two cells. Triangles of which two corners come into one place are left out: a segment is left of
/// them. They lie in temporary files. Thread-safety: one thread; constant data after end().
class CutMesh : public MeshSink {
  public:
    CutMesh(const DetailGrid& grid, const ScratchFolder& folder)
        : grid_(grid), triangles_(folder) {}

    /// Throws Error{limit} for more cells than are numbered.
    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& /*batch*/) override {}
    void add_elements(const ElementBatch& batch) override;
    void end() override;

    // After end():

    [[nodiscard]] const DetailGrid& grid() const { return grid_; }
    /// Cells have numbers below this, in the order of the Z-curve; few of them have triangles.
    [[nodiscard]] std::uint32_t cells() const { return std::uint32_t{1} << order_.bits(); }
    [[nodiscard]] Int3 cell(std::uint32_t number) const { return order_.cell_of(number); }
    [[nodiscard]] std::span<const CellTriangle> of(std::uint32_t number) const {
        return triangles_.of(number);
    }
    /// The most triangles of a cell.
    [[nodiscard]] std::uint64_t largest() const;

  private:
    void add(const Int3& strip, const CutPolygon& polygon);

    DetailGrid grid_;
    ZOrderedCells order_;
    SortedByBlocks<CellTriangle> triangles_;
};

}  // namespace isonest::detail
