// How far a surface moves when an edge is collapsed, up and down, and what of it becomes what.
//
// Source: J. Cohen, D. Manocha, M. Olano, "Simplifying polygonal models using successive mappings",
// IEEE Visualization 1997. The triangles around a vertex, the old ones, are replaced by a fan from
// one corner of the ring around it. If both project one to one onto the same polygon, "straight
// above or below" is a bijection between them. The difference of their heights is linear on each
// cell of the overlay of both, so that its extremes lie at the cells' corners: the vertex, the
// ring, and where spokes from the vertex cross those from the fan's corner.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "query/simplify/collapse/star_collapse.h"
#include "query/simplify/mapping/displacement.h"

namespace isonest::detail {

/// Not thread-safe.
class FanOverlay {
  public:
    /// Whether old and new triangles are the same polygon, seen from some direction, each with all
    /// front sides up. `star` has to stay.
    [[nodiscard]] bool look_at(const Star& star);
    /// Looks where old and new triangles cross. False: rounding hides it. REQUIRES: look_at() was
    /// true.
    [[nodiscard]] bool crosses();
    /// That of new triangle j, from those of the old ones at [0] to [n - 1]. REQUIRES: crosses()
    /// was true.
    [[nodiscard]] Displacement displacement(std::size_t j,
                                            std::span<const Displacement* const> before) const;

  private:
    struct Seen {
        double u, v, height;
    };
    void look_down();
    [[nodiscard]] bool are_front_sides_up() const;
    [[nodiscard]] bool cross_spokes();
    /// Whether new triangle j may be over the middle.
    [[nodiscard]] bool has_middle(std::size_t j) const { return left_[j] && right_[j + 1]; }
    [[nodiscard]] bool look_over_middle(std::size_t j);

    const Star* star_ = nullptr;
    std::size_t count_ = 0;
    Double3 up_{};
    double widest_ = 0;    ///< distance of a corner from the middle, seen from above
    double highest_ = 0;   ///< height of a corner over the middle or below
    double rounding_ = 0;  ///< of heights, at most
    std::array<Seen, Star::kMostCorners> seen_;
    /// Whether the middle may lie to the left, or to the right, of new spoke j.
    std::array<bool, Star::kMostCorners> left_;
    std::array<bool, Star::kMostCorners> right_;
    /// New above old where old spoke i crosses new spoke j; [n] is [0].
    std::array<std::array<double, Star::kMostCorners>, Star::kMostCorners + 1> above_;
    std::array<double, Star::kMostCorners> over_;  ///< the middle, of the triangles that have it
};

}  // namespace isonest::detail
