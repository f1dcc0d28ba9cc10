// A partition of space into cubes of bounded work.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/block_files.h"
#include "query/values/flat_pieces.h"
#include "store/base/vectors.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The position of the lattice in the world, in its own axes: world = origin +
/// steps.vector(position).
struct WorldLattice {
    Double3 origin{};
    LatticeSteps steps;
    Int3 nodes{1, 1, 1};

    [[nodiscard]] Double3 relative(const Double3& world) const {
        return {world[0] - origin[0], world[1] - origin[1], world[2] - origin[2]};
    }
    [[nodiscard]] Double3 position_of(const Double3& world) const {
        return steps.steps_of(relative(world));
    }
    /// Calls f(triangle) with triangles in lattice coordinates that together are the triangle of
    /// the world, as for_each_flat_piece() does.
    template <class F>
    bool for_each_piece(const std::array<Double3, 3>& t, const F& f) const {
        return for_each_flat_piece(steps, {relative(t[0]), relative(t[1]), relative(t[2])}, {},
                                   [&](const std::array<Double3, 3>& piece,
                                       const std::array<double, 3>&) { return f(piece); });
    }
};

/// Number of grids whose borders cross each other: BlockGrid's `thirds` from 0 on.
inline constexpr int kBlockShifts = 3;

/// Octree cells that have at most a given number of triangles, or the smallest size. The start of
/// the cells is shifted, so the borders of two grids with different shifts cross each other but do
/// not coincide. Source of shifts by thirds: T. Chan, "Approximate nearest neighbor queries
/// revisited", Discrete and Computational Geometry 20 (1998). The cells depend only on the mesh.
/// They are numbered along z, so that successive grids with different shifts sweep through the
/// volume in the same way: the contents of a grid's block are in a block of the next grid soon
/// after. The table is in a temporary file. Thread-safety: constant once it is made.
class BlockGrid {
  public:
    /// `thirds`: shift by this many thirds of the whole grid's size: 0, 1 or 2. `most`: maximum
    /// number of `triangles` in a block; their corners are vertices of `mesh`.
    BlockGrid(const WorldLattice& lattice, const ScratchMesh& mesh, const CornerView& triangles,
              int thirds, std::uint32_t most, const ScratchFolder& folder, Progress& progress);
    /// For triangles that are counted one by one, and finally divided into blocks. `mesh` must
    /// outlive it; it may get more vertices.
    BlockGrid(const WorldLattice& lattice, const ScratchMesh& mesh, int thirds,
              const ScratchFolder& folder);
    void count(const ElementCorners& triangle);
    void divide(std::uint32_t most);

    [[nodiscard]] std::uint32_t blocks() const { return blocks_; }
    /// The block that contains the triangle's centroid.
    [[nodiscard]] std::uint32_t block_of(const ElementCorners& triangle) const;
    using Points = std::array<std::array<float, 3>, 3>;
    [[nodiscard]] std::uint32_t block_of(const Points& triangle) const;

  private:
    static constexpr std::int64_t kCell = 8;  ///< nodes along an edge of the smallest cell
    [[nodiscard]] Points points_of(const ElementCorners& triangle) const;
    [[nodiscard]] std::size_t cell_of(const Points& triangle) const;
    [[nodiscard]] std::uint64_t count_in(const Int3& low, std::int64_t size) const;
    /// The start of a block, and its number in the order of the octree.
    struct Begin {
        std::int64_t z;
        std::int64_t y;
        std::int64_t x;
        std::uint64_t number;
    };
    void divide(const Int3& low, std::int64_t size, std::uint32_t most, GrowingFile<Begin>& begins);

    WorldLattice lattice_;
    const ScratchMesh& mesh_;
    Int3 shift_;
    std::int64_t size_;  ///< size of the octree, in cells
    Int3 first_;         ///< first cell of the table
    Int3 cells_;         ///< size of the table, which has only cells that touch the volume
    ScratchFolder folder_;
    ScratchFile file_;  ///< number of triangles of each cell, later its block
    std::uint32_t blocks_ = 0;
};

}  // namespace isonest::detail
