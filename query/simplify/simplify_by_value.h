// Simplifies a patch or a whole mesh within an error of the values.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include <isonest/progress.h>
#include <isonest/stop.h>
#include <isonest/world.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/block_grid.h"
#include "query/simplify/patch.h"
#include "query/simplify/proof/value_cover.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// Simplifies a patch so that on none of its triangles the data differ from the isovalue by more
// than an error.
//
// Edges are collapsed one after another (query/simplify/collapse/star_collapse.h). Each collapse
// requires a proof that its triangles are within the error (query/simplify/proof/value_cover.h);
// the order does not matter for the guarantee.
//
// A cap of a closed surface is not an isosurface; there the criterion is the area that the cap
// loses or gains. A collapse inside a cap covers the same area as before, because nothing folds
// over. A collapse on the line where surface and cap meet moves this line over triangles, and these
// must be within the error.

inline constexpr std::uint32_t kNotInPatch = std::numeric_limits<std::uint32_t>::max();

struct ValuePatch {
    std::vector<PatchTriangle> triangles;
    std::vector<bool> tried;  ///< as in the patch, for the next pass
    /// For each triangle: its index in the patch; kNotInPatch: it is new.
    std::vector<std::uint32_t> place;
    double largest = 0;  ///< maximum of |U - iso| on all triangles that were made
};

/// Maximum heap per triangle of a patch during simplify_patch_by_value(), including the patch.
inline constexpr std::size_t kValuePatchBytesPerTriangle = 800;

/// `error`: that of the proof. `has_caps`: whether triangles in a face of the patch's box are caps;
/// other triangles may lie anywhere. The patch's `stay`, `fine` and `witnesses` are not used.
/// Thread-safe, with different `proof`.
ValuePatch simplify_patch_by_value(const Patch& patch, bool has_caps, double error,
                                   ValueProof& proof, Effort effort);

// Simplifies a whole mesh, out of core, so that on none of its triangles the data differ from the
// isovalue by more than an error.
//
// Works in blocks with locked borders, in three passes with different borders, like
// query/simplify/simplify_mesh.h. Whether a triangle is within the error depends on the triangle
// alone, so blocks exchange only their triangles. query/DISTANCE.md explains why the error bound
// holds.

/// Heap that one thread needs for a block, not including its GridNumbers.
std::uint64_t simplify_by_value_heap(Cells cells);

/// The criterion of the simplification.
struct ValueLimit {
    double iso = 0;
    double error = 0;  ///< maximum of |U - iso|, in units of the data; > 0
    /// Creates the numbers that one thread reads; called from many threads.
    std::function<std::unique_ptr<GridNumbers>()> numbers;
    bool has_caps = false;  ///< triangles in the faces of the box are caps
    /// U is linear on the finest tetrahedra, or trilinear on the finest hexahedra.
    Cells cells = Cells::tetrahedra;
    Effort effort = Effort::best;
};

class SimplifiedByValue {
  public:
    /// `triangles`: their corners are vertices of `mesh`. `box`: to which they are clipped. The
    /// topology is preserved; the result does not depend on the number of threads. REQUIRES:
    /// mesh.layout().corners == 3, the lattice has three dimensions; called within an arena with as
    /// many threads as there is memory for. Throws Error{io, cancelled}, and what the numbers
    /// throw.
    SimplifiedByValue(const ScratchMesh& mesh, const CornerView& triangles,
                      const WorldLattice& lattice, const PatchBox& box, const ValueLimit& limit,
                      const ScratchFolder& folder, Progress& progress);

    [[nodiscard]] std::span<const ElementCorners> corners() const {
        return {corners_.as<ElementCorners>().data(), static_cast<std::size_t>(count_)};
    }
    /// Maximum of |U - iso| on all triangles that were made; at most the error.
    [[nodiscard]] double largest() const { return largest_; }
    /// For hexahedra: maximum of |U - iso| on all unchanged triangles, except caps. Infinite:
    /// unknown because of missing values.
    [[nodiscard]] double largest_kept() const { return largest_kept_; }

  private:
    ScratchFile corners_;
    std::uint64_t count_ = 0;
    double largest_ = 0;
    double largest_kept_ = 0;
};

}  // namespace isonest::detail
