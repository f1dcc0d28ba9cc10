// The triangles of a patch with their neighbours across edges, for collapsing edges.
//
// Source of the structure: J. Rossignac, "Edgebreaker: connectivity compression for triangle
// meshes", IEEE TVCG 5 (1999): the corner table. Source of the conditions for a collapse: T. Dey,
// H. Edelsbrunner, S. Guha, D. Nekhayev, "Topology preserving edge contraction" (1999).
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "query/simplify/patch.h"

namespace isonest::detail {

/// Half-edge h is that of triangle h / 3 from its corner h % 3 to the next. All data is in flat
/// arrays, so that a block stays in the processor's cache. Not thread-safe.
class CornerMesh {
  public:
    static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

    /// `locked`: vertices that are kept. Vertices at which the triangles form neither a disk nor
    /// half of one, and their neighbours, are added.
    CornerMesh(std::size_t vertices, std::span<const PatchTriangle> triangles,
               std::vector<bool>& locked);

    [[nodiscard]] std::size_t triangles() const { return across_.size() / 3; }
    [[nodiscard]] bool is_gone(std::uint32_t triangle) const {
        return start_[std::size_t{3} * triangle] == kNone;
    }
    [[nodiscard]] PatchTriangle corners(std::uint32_t triangle) const {
        const std::size_t h = std::size_t{3} * triangle;
        return {start_[h], start_[h + 1], start_[h + 2]};
    }
    static std::uint32_t next(std::uint32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
    static std::uint32_t previous(std::uint32_t h) { return h % 3 == 0 ? h + 2 : h - 1; }
    [[nodiscard]] std::uint32_t start(std::uint32_t h) const { return start_[h]; }
    [[nodiscard]] std::uint32_t end(std::uint32_t h) const { return start_[next(h)]; }
    /// The opposite half-edge; kNone at a border.
    [[nodiscard]] std::uint32_t across(std::uint32_t h) const { return across_[h]; }
    /// A half-edge from `v`: at a border, the one on it; kNone: there is none.
    [[nodiscard]] std::uint32_t first(std::uint32_t v) const { return first_[v]; }
    /// The next half-edge from the same vertex, counterclockwise.
    [[nodiscard]] std::uint32_t turned(std::uint32_t h) const { return across_[previous(h)]; }

    /// The neighbours of a vertex, counterclockwise.
    struct Ring {
        std::uint32_t middle = kNone;
        std::vector<std::uint32_t> vertices;
        /// Half-edges from the middle to each of them; the last vertex of an open ring has none.
        std::vector<std::uint32_t> halves;
        bool is_closed = true;  ///< false: the middle lies on a border, between first and last
    };
    void ring_of(std::uint32_t v, Ring& ring) const;

    /// Whether the topology is preserved if the middle of the ring becomes the vertex at `place` in
    /// it, without creating an edge or triangle whose vertices are all locked, except for an edge
    /// to `free`. REQUIRES: the middle is not locked.
    [[nodiscard]] bool keeps_topology(const Ring& ring, std::size_t place,
                                      const std::vector<bool>& locked, std::uint32_t free = kNone);
    /// Collapses the middle into the vertex at `place`. REQUIRES: keeps_topology().
    void collapse(const Ring& ring, std::size_t place);

  private:
    void join(std::uint32_t a, std::uint32_t b);

    std::vector<std::uint32_t> start_;  ///< kNone: removed
    std::vector<std::uint32_t> across_;
    std::vector<std::uint32_t> first_;
    std::vector<std::uint32_t> seen_in_;  ///< number of the question, for each vertex
    std::uint32_t question_ = 0;
};

}  // namespace isonest::detail
