// A partition of space into cubes of bounded work.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include <isonest/int3.h>
#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/growing_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The lattice in the world: world = origin + spacing * position.
struct WorldLattice {
    Double3 origin{};
    Double3 spacing{1, 1, 1};
    Int3 nodes{1, 1, 1};
};

/// Grids whose borders cross each other: BlockGrid's `thirds` from 0 on.
inline constexpr int kBlockShifts = 3;

/// Octree cells with at most a number of triangles, or of the smallest size. Where the cells begin
/// is shifted, so that the borders of two grids with different shifts cross but do not run along
/// each other. Source of shifts by thirds: T. Chan, "Approximate nearest neighbor queries
/// revisited", Discrete and Computational Geometry 20 (1998). The cells are the same for the same
/// mesh. They are numbered along z, so that grids with different shifts, one after the other, sweep
/// through the volume alike: what came from a grid's block is in one of the next grid's soon after.
/// Its table lies in a temporary file. Thread-safety: constant once it is made.
class BlockGrid {
  public:
    /// `thirds`: of the whole grid's size, by which it is shifted: 0, 1 or 2. `most`: of
    /// `triangles` in a block; their corners are vertices of `mesh`.
    BlockGrid(const WorldLattice& lattice, const ScratchMesh& mesh, const CornerView& triangles,
              int thirds, std::uint32_t most, const ScratchFolder& folder, Progress& progress);
    /// For triangles that are then counted one by one, and divided into blocks at last. `mesh` has
    /// to stay; it may get more vertices.
    BlockGrid(const WorldLattice& lattice, const ScratchMesh& mesh, int thirds,
              const ScratchFolder& folder);
    void count(const ElementCorners& triangle);
    void divide(std::uint32_t most);

    [[nodiscard]] std::uint32_t blocks() const { return blocks_; }
    /// The block that a triangle's centroid lies in.
    [[nodiscard]] std::uint32_t block_of(const ElementCorners& triangle) const;
    using Points = std::array<std::array<float, 3>, 3>;
    [[nodiscard]] std::uint32_t block_of(const Points& triangle) const;

  private:
    static constexpr std::int64_t kCell = 8;  ///< nodes along an edge of the smallest cell
    [[nodiscard]] Points points_of(const ElementCorners& triangle) const;
    [[nodiscard]] std::size_t cell_of(const Points& triangle) const;
    [[nodiscard]] std::uint64_t count_in(const Int3& low, std::int64_t size) const;
    /// Where a block begins, and its number in the order of the octree.
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
    std::int64_t size_;  ///< of the octree, in cells
    Int3 first_;         ///< cell of the table
    Int3 cells_;         ///< of the table, which has only those that the volume touches
    ScratchFolder folder_;
    ScratchFile file_;  ///< triangles of each cell, and then its block
    std::uint32_t blocks_ = 0;
};

}  // namespace isonest::detail
