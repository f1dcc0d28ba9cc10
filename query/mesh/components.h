// The connected components of a mesh, and those of them that are worth keeping.
#pragma once

#include <cstdint>
#include <span>

#include <isonest/extract.h>
#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The elements of the components that are kept, in their order. What is kept depends on the mesh
/// and the choice alone. Nothing of it is heap that grows with the mesh.
class KeptComponents {
  public:
    /// REQUIRES: every vertex of `mesh` is named by an element, which outlives this; an element
    /// has three corners if choice.least_volume > 0. Throws Error{io, cancelled}.
    KeptComponents(const ScratchMesh& mesh, const ComponentChoice& choice,
                   const ScratchFolder& folder, Progress& progress);

    [[nodiscard]] const CornerView& corners() const { return corners_; }
    /// That has the corners, if any component was dropped.
    [[nodiscard]] CornerFile& file() { return corner_file_; }
    /// Of the whole mesh.
    [[nodiscard]] std::uint64_t components() const { return components_; }
    [[nodiscard]] std::uint64_t dropped() const { return dropped_; }
    [[nodiscard]] std::uint64_t dropped_elements() const { return dropped_elements_; }
    /// Elements of the largest component that was dropped; 0 if none was.
    [[nodiscard]] std::uint64_t largest_dropped() const { return largest_dropped_; }

  private:
    CornerFile corner_file_;
    CornerView corners_;
    std::uint64_t components_ = 0;
    std::uint64_t dropped_ = 0;
    std::uint64_t dropped_elements_ = 0;
    std::uint64_t largest_dropped_ = 0;
};

/// How many components there are of elements whose corners are vertices below `vertices`, and the
/// elements of the largest one.
struct ComponentSizes {
    std::uint64_t components = 0;
    std::uint64_t largest = 0;
};
/// Throws Error{io}. Without heap that grows with the mesh.
ComponentSizes component_sizes(std::uint64_t vertices, const CornerView& elements,
                               const ScratchFolder& folder);

}  // namespace isonest::detail
