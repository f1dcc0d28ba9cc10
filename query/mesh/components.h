// The connected components of a mesh, and the selection of those to be kept.
#pragma once

#include <cstdint>
#include <span>

#include <isonest/extract.h>
#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The elements of the kept components, in their order. The selection depends only on the mesh and
/// the choice. No heap grows with the mesh.
class KeptComponents {
  public:
    /// REQUIRES: every vertex of `mesh` is used by an element, and it outlives this object;
    /// elements have three corners if choice.min_volume > 0. Throws Error{io, cancelled}.
    KeptComponents(const ScratchMesh& mesh, const ComponentChoice& choice,
                   const ScratchFolder& folder, Progress& progress);

    [[nodiscard]] const CornerView& corners() const { return corners_; }
    /// The file that contains the corners, if any component was dropped.
    [[nodiscard]] CornerFile& file() { return corner_file_; }
    [[nodiscard]] const ComponentReport& report() const { return report_; }

  private:
    CornerFile corner_file_;
    CornerView corners_;
    ComponentReport report_;
};

/// The number of components of elements whose corners are vertices below `vertices`, and the number
/// of elements of the largest one.
struct ComponentSizes {
    std::uint64_t components = 0;
    std::uint64_t largest = 0;
};
/// Throws Error{io}. No heap grows with the mesh.
ComponentSizes component_sizes(std::uint64_t vertices, const CornerView& elements,
                               const ScratchFolder& folder);

}  // namespace isonest::detail
