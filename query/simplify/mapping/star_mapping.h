// The displacements of a patch's triangles while its edges are collapsed.
#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "query/simplify/collapse/collapse_stars.h"
#include "query/simplify/collapse/edge_queue.h"
#include "query/simplify/collapse/star_collapse.h"
#include "query/simplify/mapping/displacement.h"
#include "query/simplify/mapping/fan_overlay.h"

namespace isonest::detail {

/// Edges of which the quadrics estimate that they are further off, in limits, are not tried.
inline constexpr double kFurthestMapped = 1.5;
/// Cosine of the angle between normals from which on an edge is a fold: 72 degrees.
inline constexpr float kMostMappedFold = 0.309F;

/// Not thread-safe.
class StarMapping {
  public:
    /// `displacements`: of each triangle of the patch; they have to stay.
    explicit StarMapping(std::vector<Displacement>& displacements)
        : displacements_(displacements) {}

    /// Whether old and new triangles project one to one onto the same polygon. `collapse` was
    /// looked at, and has to stay.
    [[nodiscard]] bool look(const StarCollapse& collapse) {
        if (!project(collapse)) {
            return false;
        }
        for (std::size_t i = 0; i < corners_; ++i) {
            before_[i] = i == missing_ ? nullptr : &displacements_[collapse.triangle(i)];
        }
        return true;
    }
    /// The same where the middle was moved by this before.
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
    /// Finds the displacement of new triangle j: its bound. REQUIRES: look() was true.
    double map(std::size_t j) {
        after_[j] = overlay_.displacement(j, {before_.data(), corners_});
        return after_[j].bound();
    }
    /// When the collapse of an edge comes that is made if no triangle moves further than the limit,
    /// none becomes a needle and no edge is folded anew (collapse_stars()): kNever if it is not.
    float due(StarCollapse& collapse, const EdgeQueue::Edge& edge, double limit) {
        if (!collapse.look(edge.from, edge.to) || !collapse.has_no_new_needle() ||
            !collapse.has_no_new_fold(kMostMappedFold) || !look(collapse)) {
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
    /// A collapse that leaves this bound comes no sooner than if the quadrics estimated a part of
    /// it. So bounds grow everywhere alike, and heights of both signs make up for each other: 8 to
    /// 15 % fewer triangles.
    static float due_at(double bound) {
        constexpr double kBoundWeight = 0.7;
        const double part = kBoundWeight * bound;
        return static_cast<float>(part * part);
    }
    /// New triangle j is no further than this from the full surface: measured, not mapped.
    void set_measured(std::size_t j, double distance) {
        after_[j] = {};
        after_[j].radius = float_above(distance);
    }
    /// The new displacements are those of the triangles in whose places the new ones are.
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
    std::array<const Displacement*, Star::kMostCorners> before_{};
    std::array<Displacement, Star::kMostCorners> slid_{};
    std::size_t missing_ = Star::kNone;
    std::size_t corners_ = 0;  ///< of the star that was looked at
    std::array<Displacement, Star::kMostCorners> after_{};
};

}  // namespace isonest::detail
