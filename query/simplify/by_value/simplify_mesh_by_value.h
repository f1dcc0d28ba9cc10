// Fewer triangles for a whole mesh, on none of which the data are further from the isovalue than an
// error; out of core.
//
// In blocks with locked borders, three times with other borders, as
// query/simplify/simplify_mesh.h. Whether a triangle is within the error depends on the triangle
// alone, so blocks have nothing to tell each other but their triangles. Why the error holds is in
// query/DISTANCE.md.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "query/simplify/block_grid.h"
#include "query/simplify/by_value/value_tree.h"
#include "query/simplify/patch.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Heap that one thread needs for a block, beside that of its GridNumbers.
std::uint64_t simplify_by_value_heap();

/// What a mesh is simplified by.
struct ValueLimit {
    double iso = 0;
    double error = 0;  ///< |U - iso| at most, in units of the data; > 0
    /// Makes the numbers that one thread looks at; called from many threads.
    std::function<std::unique_ptr<GridNumbers>()> numbers;
    bool has_caps = false;  ///< triangles in the faces of the box are caps
};

class SimplifiedByValue {
  public:
    /// `triangles`: their corners are vertices of `mesh`, and they are within the error. `box`: to
    /// which they are cut. The topology stays; the same result for any number of threads. REQUIRES:
    /// mesh.layout().corners == 3, the lattice has three dimensions; is called within an arena of
    /// as many threads as there is memory for. Throws Error{io, cancelled}, and what the numbers
    /// throw.
    SimplifiedByValue(const ScratchMesh& mesh, const CornerView& triangles,
                      const WorldLattice& lattice, const PatchBox& box, const ValueLimit& limit,
                      const ScratchFolder& folder, Progress& progress);

    [[nodiscard]] std::span<const ElementCorners> corners() const {
        return {corners_.as<ElementCorners>().data(), static_cast<std::size_t>(count_)};
    }
    /// |U - iso| was not larger on any triangle that was made; at most the error.
    [[nodiscard]] double largest() const { return largest_; }

  private:
    ScratchFile corners_;
    std::uint64_t count_ = 0;
    double largest_ = 0;
};

}  // namespace isonest::detail
