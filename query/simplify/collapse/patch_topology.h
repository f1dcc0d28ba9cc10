// Whether a patch that was simplified has the topology that it had before.
//
// Source: T. Dey, H. Edelsbrunner, S. Guha, D. Nekhayev, "Topology preserving edge contraction"
// (1999), for what an edge collapse may not do. Here the result is looked at and not the collapses:
// links of vertices, and the Euler characteristic of each component, which with the borders fixed
// say that two patches are the same surface.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "query/simplify/patch.h"

namespace isonest::detail {

/// How the triangles around a vertex hang together.
enum class LinkShape : std::uint8_t {
    none,    ///< there are no triangles
    cycle,   ///< they close around it
    path,    ///< from one border edge to another
    tangled  ///< anything else
};
struct Link {
    LinkShape shape = LinkShape::none;
    std::uint32_t first = 0;  ///< ends of a path
    std::uint32_t last = 0;
};

/// Of all `vertices`, those of `triangles`.
std::vector<Link> links_of(std::size_t vertices, std::span<const PatchTriangle> triangles);

/// What is to be kept of a patch.
class PatchTopology {
  public:
    /// `before`: its triangles, smallest corner first, as those of changes() are. Vertices whose
    /// link is tangled have to keep all their triangles.
    PatchTopology(const Patch& patch, std::span<const PatchTriangle> before);

    [[nodiscard]] const std::vector<Link>& links() const { return links_; }
    /// Vertices where the topology of `after` is another one; all of a component whose Euler
    /// characteristic is, or of which nothing is left. REQUIRES: its triangles name vertices of
    /// `before`.
    [[nodiscard]] std::vector<std::uint32_t> changes(std::span<const PatchTriangle> after) const;

  private:
    [[nodiscard]] std::vector<std::int64_t> characteristics(
        std::span<const PatchTriangle> triangles) const;
    [[nodiscard]] bool is_shared(const PatchTriangle& t) const;
    [[nodiscard]] bool was_edge(std::uint32_t a, std::uint32_t b) const;

    const std::vector<bool>& shared_;
    std::vector<Link> links_;
    std::vector<std::uint32_t> component_;         ///< of each vertex
    std::vector<std::uint64_t> shared_edges_;      ///< between shared vertices, sorted
    std::vector<PatchTriangle> shared_triangles_;  ///< all of whose vertices are, sorted
    std::vector<std::int64_t> characteristic_;     ///< of each component
};

}  // namespace isonest::detail
