// The connected components of a mesh, and those of them that are worth keeping.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>

#include <isonest/extract.h>
#include <isonest/progress.h>

#include "query/mesh/scratch_mesh.h"

namespace isonest::detail {

/// The elements of the components that are kept, in their order. What is kept depends on the mesh
/// and the choice alone. Nothing of it is heap that grows with the mesh.
class KeptComponents {
  public:
    /// REQUIRES: every vertex of `mesh` is named by an element, which outlives this; an element
    /// has three corners if choice.least_volume > 0. Throws Error{io, cancelled}.
    KeptComponents(const ScratchMesh& mesh, const ComponentChoice& choice,
                   const std::filesystem::path& folder, Progress& progress);

    [[nodiscard]] std::span<const ElementCorners> corners() const { return corners_; }
    /// Of the whole mesh.
    [[nodiscard]] std::uint64_t components() const { return components_; }
    [[nodiscard]] std::uint64_t dropped() const { return dropped_; }
    [[nodiscard]] std::uint64_t dropped_elements() const { return dropped_elements_; }
    /// Elements of the largest component that was dropped; 0 if none was.
    [[nodiscard]] std::uint64_t largest_dropped() const { return largest_dropped_; }
    /// Bytes of all temporary files, at most.
    [[nodiscard]] std::uint64_t scratch_bytes() const { return scratch_bytes_; }

  private:
    ScratchFile corner_file_;
    std::span<const ElementCorners> corners_;
    std::uint64_t components_ = 0;
    std::uint64_t dropped_ = 0;
    std::uint64_t dropped_elements_ = 0;
    std::uint64_t largest_dropped_ = 0;
    std::uint64_t scratch_bytes_ = 0;
};

/// How many components there are of elements whose corners are vertices below `vertices`, and the
/// elements of the largest one.
struct ComponentSizes {
    std::uint64_t components = 0;
    std::uint64_t largest = 0;
};
/// Throws Error{io}. Without heap that grows with the mesh.
ComponentSizes component_sizes(std::uint64_t vertices, std::span<const ElementCorners> elements,
                               const std::filesystem::path& folder);

}  // namespace isonest::detail
