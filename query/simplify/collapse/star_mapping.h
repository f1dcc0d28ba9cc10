// The displacements of a patch's triangles while its edges are collapsed.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "query/simplify/collapse/edge_queue.h"
#include "query/simplify/collapse/star_collapse.h"
#include "query/simplify/patch.h"

namespace isonest::detail {

// How far a surface moves up and down when an edge is collapsed, and which of its parts are mapped
// to which.
//
// Source: J. Cohen, D. Manocha, M. Olano, "Simplifying polygonal models using successive mappings",
// IEEE Visualization 1997. The triangles around a vertex, the old ones, are replaced by a fan from
// one corner of the ring around it. If both project one to one onto the same polygon, "straight
// above or below" is a bijection between them. The difference of their heights is linear on each
// cell of the overlay of both, so its extremes are at the cells' corners: the vertex, the ring, and
// the points where spokes from the vertex cross those from the fan's corner.

/// Not thread-safe.
class FanOverlay {
  public:
    /// Whether old and new triangles, seen from some direction, are the same polygon with all front
    /// sides up. `star` must stay valid.
    [[nodiscard]] bool look_at(const Star& star);
    /// Computes where old and new triangles cross. Returns false if rounding makes this unclear.
    /// REQUIRES: look_at() was true.
    [[nodiscard]] bool crosses();
    /// Displacement of new triangle j, from those of the old ones at [0] to [n - 1]. REQUIRES:
    /// crosses() was true.
    [[nodiscard]] Displacement displacement(std::size_t j,
                                            std::span<const Displacement* const> before) const;

  private:
    struct Seen {
        double u, v, height;
    };
    void look_down();
    [[nodiscard]] bool are_front_sides_up() const;
    [[nodiscard]] bool cross_spokes();
    /// Whether new triangle j may be above the middle.
    [[nodiscard]] bool has_middle(std::size_t j) const { return left_[j] && right_[j + 1]; }
    [[nodiscard]] bool look_over_middle(std::size_t j);

    const Star* star_ = nullptr;
    std::size_t count_ = 0;
    Double3 up_{};
    double widest_ = 0;    ///< distance of a corner from the middle, seen from above
    double highest_ = 0;   ///< maximum height of a corner above or below the middle
    double rounding_ = 0;  ///< maximum rounding error of heights
    std::array<Seen, Star::kMaxCorners> seen_;
    /// Whether the middle may lie to the left (right) of new spoke j.
    std::array<bool, Star::kMaxCorners> left_;
    std::array<bool, Star::kMaxCorners> right_;
    /// Height of new above old where old spoke i crosses new spoke j; [n] is [0].
    std::array<std::array<double, Star::kMaxCorners>, Star::kMaxCorners + 1> above_;
    std::array<double, Star::kMaxCorners> over_;  ///< height of triangles above the middle, if they
                                                  ///< cover it
};

/// Edges with a larger quadric estimate than this multiple of the limit are not tried.
inline constexpr double kFurthestMapped = 1.5;
/// Cosine of the angle between normals from which an edge counts as a fold: 72 degrees.
inline constexpr float kMaxMappedFold = 0.309F;

/// Not thread-safe.
class StarMapping {
  public:
    /// `displacements`: of each triangle of the patch; must outlive this object.
    explicit StarMapping(std::vector<Displacement>& displacements)
        : displacements_(displacements) {}

    /// Whether old and new triangles project one to one onto the same polygon. `collapse` was
    /// examined, and must stay valid.
    [[nodiscard]] bool look(const StarCollapse& collapse) {
        if (!project(collapse)) {
            return false;
        }
        for (std::size_t i = 0; i < corners_; ++i) {
            before_[i] = i == missing_ ? nullptr : &displacements_[collapse.triangle(i)];
        }
        return true;
    }
    /// The same if the middle was moved by this vector before.
    [[nodiscard]] bool look(const StarCollapse& collapse, const Double3& slid) {
        if (!project(collapse)) {
            return false;
        }
        for (std::size_t i = 0; i < corners_; ++i) {
            if (i != missing_) {
                slid_[i] = moved_up_to(displacements_[collapse.triangle(i)], slid);
                before_[i] = &slid_[i];
            }
        }
        return true;
    }
    /// Computes the displacement of new triangle j and returns its bound. REQUIRES: look() was
    /// true.
    double map(std::size_t j) {
        after_[j] = overlay_.displacement(j, {before_.data(), corners_});
        return after_[j].bound();
    }
    /// When the collapse of an edge is due, for collapse_stars(). It is made if no triangle moves
    /// further than the limit, none becomes a needle and no edge is newly folded; otherwise kNever.
    float due(StarCollapse& collapse, const EdgeQueue::Edge& edge, double limit) {
        if (!collapse.look(edge.from, edge.to) || !collapse.has_no_new_needle() ||
            !collapse.has_no_new_fold(kMaxMappedFold) || !look(collapse)) {
            return kNever;
        }
        double largest = 0;
        for (std::size_t j = 1; j + 1 < collapse.star().corners; ++j) {
            largest = std::max(largest, map(j));
            if (!(largest <= limit)) {
                return kNever;
            }
        }
        return due_at(largest);
    }
    /// A collapse with this bound is due no earlier than if the quadrics had estimated a part of
    /// it. So bounds grow evenly everywhere, and heights of both signs compensate each other: 8 to
    /// 15 % fewer triangles.
    static float due_at(double bound) {
        constexpr double kBoundWeight = 0.7;
        const double part = kBoundWeight * bound;
        return static_cast<float>(part * part);
    }
    /// Sets the distance of new triangle j from the full surface: measured, not mapped.
    void set_measured(std::size_t j, double distance) {
        after_[j] = {};
        after_[j].radius = float_above(distance);
    }
    /// Stores the new displacements at the indices of the triangles that the new ones replace.
    void take(const StarCollapse& collapse) {
        for (std::size_t j = 1; j + 1 < collapse.star().corners; ++j) {
            displacements_[collapse.triangle(j)] = after_[j];
        }
    }

  private:
    [[nodiscard]] bool project(const StarCollapse& collapse) {
        const Star& star = collapse.star();
        corners_ = star.corners;
        missing_ = star.missing;
        return overlay_.look_at(star) && overlay_.crosses();
    }

    std::vector<Displacement>& displacements_;
    FanOverlay overlay_;
    std::array<const Displacement*, Star::kMaxCorners> before_{};
    std::array<Displacement, Star::kMaxCorners> slid_{};
    std::size_t missing_ = Star::kNone;
    std::size_t corners_ = 0;  ///< of the examined star
    std::array<Displacement, Star::kMaxCorners> after_{};
};

}  // namespace isonest::detail
