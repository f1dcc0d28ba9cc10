// Repairs triangles without area while a mesh is still in slabs, so that the rest of it is
// assembled as if there were none.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <isonest/int3.h>
#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/mesh/mend_triangles.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// A slab whose vertices have numbers in the mesh. Does not own its data.
struct NumberedSlab {
    static constexpr std::uint32_t kNoNumber = 0xFFFFFFFFU;

    std::span<const std::array<float, 3>> positions;
    std::span<const std::array<std::uint32_t, 3>> triangles;  ///< corners: indices into `positions`
    /// For each position, its number in the order of first use by triangles of the mesh; kNoNumber:
    /// unused. Numbers from `first_vertex` on are the slab's own, others belong to earlier slabs.
    std::span<const std::uint32_t> number;
    std::span<const std::uint32_t> flat;  ///< triangles without area, ascending
    std::uint64_t first_vertex = 0;
    std::uint64_t first_triangle = 0;  ///< number in the mesh of the slab's first triangle
};

/// The changes made by mending, usually to few triangles and vertices. "Before" and "now" refer to
/// numbers of vertices and triangles before and after the changes.
class MeshChanges {
  public:
    static constexpr std::uint32_t kGone = NumberedSlab::kNoNumber;
    /// A triangle that is removed, or whose corners are replaced or moved.
    struct Changed {
        std::uint64_t triangle;                ///< before
        std::array<std::uint32_t, 3> corners;  ///< numbers before; kNoTriangle, if it is removed
    };
    struct Moved {
        std::uint32_t vertex;  ///< before
        std::array<float, 3> to;
    };

    /// Nothing changes.
    MeshChanges() = default;
    /// Repairs triangles without area. `lo`, `hi`: the box of the mesh; `min_step`: see
    /// mend_triangles(). Uses all threads of the arena. Throws Error{io, cancelled}.
    MeshChanges(std::span<const NumberedSlab> slabs, const std::array<float, 3>& lo,
                const std::array<float, 3>& hi, const Double3& min_step,
                const ScratchFolder& folder, Progress& progress);

    [[nodiscard]] const MendedTriangles& mended() const { return mended_; }
    /// Sorted by triangle and by vertex, ascending.
    [[nodiscard]] std::span<const Changed> changed() const { return changed_; }
    [[nodiscard]] std::span<const Moved> moved() const { return moved_; }
    /// The changes of the triangles first ... end - 1.
    [[nodiscard]] std::span<const Changed> changed(std::uint64_t first, std::uint64_t end) const;
    [[nodiscard]] std::uint64_t gone_vertices() const { return gone_vertices_; }
    [[nodiscard]] std::uint64_t gone_triangles() const { return gone_.size(); }

    /// Maps old numbers of vertices in a range to new ones.
    class Numbers {
      public:
        /// The vertex's new number (vertices are numbered in the order of their first use), or
        /// kGone.
        [[nodiscard]] std::uint32_t operator()(std::uint32_t before) const {
            const auto at = std::lower_bound(vertices_.begin(), vertices_.end(), before);
            if (at != vertices_.end() && *at == before) {
                return now_[static_cast<std::size_t>(at - vertices_.begin())];
            }
            // Excludes vertices of changed triangles, except those of them that now come earlier.
            return before + shift_ - static_cast<std::uint32_t>(at - vertices_.begin()) +
                   static_cast<std::uint32_t>(
                       std::upper_bound(ahead_.begin(), ahead_.end(), before) - ahead_.begin());
        }
        /// Whether no vertex is a corner of a changed triangle.
        [[nodiscard]] bool are_unchanged() const { return vertices_.empty(); }

      private:
        friend class MeshChanges;
        std::span<const std::uint32_t> vertices_;
        std::span<const std::uint32_t> now_;
        std::span<const std::uint32_t> ahead_;
        std::uint32_t shift_ = 0;  ///< modulo 2^32
    };
    /// For the vertices first ... end - 1. The changes must outlive it.
    [[nodiscard]] Numbers numbers(std::uint64_t first, std::uint64_t end) const;
    /// The same for any vertex.
    [[nodiscard]] std::uint32_t vertex_now(std::uint32_t before) const {
        return numbers(0, kGone)(before);
    }
    /// REQUIRES: the triangle is kept.
    [[nodiscard]] std::uint64_t triangle_now(std::uint64_t before) const;
    [[nodiscard]] bool moves(std::uint32_t vertex_before) const;

  private:
    void renumber(std::span<const NumberedSlab> slabs, std::span<const std::uint64_t> first_named);

    MendedTriangles mended_;
    std::vector<Changed> changed_;
    std::vector<Moved> moved_;
    std::vector<std::uint64_t> gone_;  ///< triangles, ascending
    std::uint64_t gone_vertices_ = 0;
    /// Corners of changed triangles, ascending; their new numbers; and, for each that is kept and
    /// in ascending order, how many vertices were used first before the place of its first use.
    std::vector<std::uint32_t> vertices_;
    std::vector<std::uint32_t> now_;
    std::vector<std::uint32_t> ahead_;
};

}  // namespace isonest::detail
