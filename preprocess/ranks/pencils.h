// Which rank makes what: the volume's blocks, cut among ranks.
//
// Blocks are dealt out in *pencils*: all blocks with the same y and z, because sources read whole
// rows along x. Pencils of the base pass follow a Morton curve (G. M. Morton, "A Computer Oriented
// Geodetic Data Base", 1966), and each rank has a piece of it: compact, so that little is read or
// sent twice, and such that the pencils of coarser levels mostly lie on pencils of their own rank.
#pragma once

#include <cstdint>
#include <vector>

#include <isonest/int3.h>

#include "store/container/format.h"

namespace isonest::detail {

/// The pass that makes levels 0 to 2; those of coarser levels have their level's number.
inline constexpr int kBasePass = 2;

struct Pencil {
    std::int64_t y = 0;
    std::int64_t z = 0;
    bool operator==(const Pencil&) const = default;
};

/// Pencils of the base pass [y_begin, y_end) x [z_begin, z_end).
struct PencilBox {
    std::int64_t y_begin = 0;
    std::int64_t y_end = 0;
    std::int64_t z_begin = 0;
    std::int64_t z_end = 0;
    bool operator==(const PencilBox&) const = default;
};

/// How the rows of a level's cubes are cut: into pencils of 2^shift x 2^shift pencils of the base
/// pass, each of which has `cells` x `cells` rows of cubes. `grid`: pencils along y and z.
struct PencilCut {
    int shift = 0;
    std::int64_t cells = 1;
    Int3 grid{1, 1, 1};
};

/// The same on all ranks. Thread-safety: const methods from any thread. In memory it takes a few
/// bytes for each rank.
class Pencils {
  public:
    /// Pieces of the curve have nearly the same number of nodes, those in margins included. A thin
    /// last pencil of an axis goes with the one before it. REQUIRES: ranks >= 1. `layout` is
    /// borrowed.
    Pencils(const StoreLayout& layout, int ranks);

    /// Ranks.
    [[nodiscard]] int ranks() const { return static_cast<int>(first_.size()) - 1; }
    /// Blocks per axis of a pass.
    [[nodiscard]] Int3 grid(int pass) const;
    /// How a pass is cut into blocks, and so into chunks of the store.
    [[nodiscard]] PencilCut chunk_cut(int pass) const;
    /// How it is cut into what ranks compute. As long as that has two rows of cubes at least, it is
    /// what lies on a pencil of the base pass: parts of blocks, so that ranks need of each other
    /// margins alone. On coarser levels, and for one rank, it is the blocks.
    [[nodiscard]] PencilCut part_cut(int pass) const;
    [[nodiscard]] bool has_parts(int pass) const {
        return part_cut(pass).shift < chunk_cut(pass).shift;
    }

    /// Of a pencil of a cut: whoever has the first pencil of the base pass below.
    [[nodiscard]] int owner(const PencilCut& cut, const Pencil& pencil) const;
    /// Those of a rank, along the curve.
    [[nodiscard]] std::vector<Pencil> of(int rank, const PencilCut& cut) const;
    /// Of blocks.
    [[nodiscard]] int owner(int pass, const Pencil& pencil) const {
        return owner(chunk_cut(pass), pencil);
    }
    [[nodiscard]] std::vector<Pencil> of(int rank, int pass) const {
        return of(rank, chunk_cut(pass));
    }
    /// The pencils of a rank in the base pass, as few boxes, each of which is read in one go.
    [[nodiscard]] std::vector<PencilBox> boxes(int rank) const;

  private:
    [[nodiscard]] std::uint64_t code_of(const Pencil& pencil) const;
    [[nodiscard]] Pencil pencil_at(std::uint64_t code) const;

    const StoreLayout* layout_;
    Int3 base_;     ///< blocks of the base pass
    Int3 dealt_;    ///< those of them that are not thin ones at the end of y or z
    int bits_ = 0;  ///< of y and z that alternate in a code; the rest of the longer follow
    bool longer_is_y_ = true;
    std::vector<std::uint64_t> first_;  ///< code of each rank; then where codes end
};

}  // namespace isonest::detail
