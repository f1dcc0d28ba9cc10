// How far a surface moves when an edge is collapsed, by looking straight down on the triangles
// around its end.
//
// The triangles before and after have the same border, a ring. If all of both lie front side up in
// one projection, and those before go once around their middle, each projects onto the same
// polygon one to one (the degree of a map: J. Milnor, "Topology from the Differentiable Viewpoint",
// 1965, section 5). Then each point of one has a point of the other straight above or below it. The
// height between them is linear where neither has an edge, so it is largest where edges cross
// (P. Cohen, D. Manocha, M. Olano, "Simplifying polygonal models using successive mappings", 1997).
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "query/simplify/patch.h"

namespace isonest::detail {

/// Not thread-safe.
class StarDisplacement {
  public:
    /// `positions` have to stay.
    explicit StarDisplacement(std::span<const std::array<float, 3>> positions)
        : positions_(positions) {}

    /// The edges opposite to a vertex, of the triangles around it; empty them before.
    [[nodiscard]] std::vector<std::array<std::uint32_t, 2>>& opposite() { return opposite_; }
    /// The most by which the triangles of `from` with these edges and those of `to` with them are
    /// from each other, both ways, in world units. Nothing: it is not known, among others because
    /// the edges are no ring.
    std::optional<double> of(std::uint32_t from, std::uint32_t to);

  private:
    struct Seen {
        double u, v, height;
    };
    bool find_ring(std::uint32_t to);
    void look_down(std::uint32_t from);
    [[nodiscard]] bool goes_once_around() const;
    [[nodiscard]] double over_middle(std::size_t j) const;
    [[nodiscard]] double over_spokes(std::size_t j) const;

    std::span<const std::array<float, 3>> positions_;
    std::vector<std::array<std::uint32_t, 2>> opposite_;
    std::vector<std::uint32_t> ring_;  ///< from `to` on
    std::vector<Seen> seen_;           ///< of the ring, from the middle
};

}  // namespace isonest::detail
