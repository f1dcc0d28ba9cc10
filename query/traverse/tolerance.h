// An error tolerance that depends on where a node lies: finer near a point or a box, or as a camera
// sees it.
//
// A mesh without cracks needs a test that holds for a node whenever it holds for one of its
// children (section 5 of the paper). So a node is judged by the strictest tolerance in a ball
// around it that holds the balls of its children: then nothing needs to be saturated. Source of the
// nested balls: P. Lindstrom, V. Pascucci, "Visualization of large terrains made easy", IEEE
// Visualization 2001.
#pragma once

#include <array>
#include <optional>

#include <isonest/int3.h>
#include <isonest/world.h>

namespace isonest::detail {

class Tolerance {
  public:
    /// `threshold`: below it a node stops, where neither focus nor camera says otherwise.
    Tolerance(double threshold, const std::optional<Focus>& focus,
              const std::optional<Camera>& camera, const Double3& spacing, const Double3& origin);

    /// Below it a node stops, where neither focus nor camera says otherwise.
    [[nodiscard]] double threshold() const { return threshold_; }
    /// Whether no node stops.
    [[nodiscard]] bool is_zero() const { return threshold_ <= 0 && !camera_; }
    /// Whether the node with twice the finest lattice's coordinates `twice` and scale `half_scale`
    /// / 2 stops, its stop field being eta.
    [[nodiscard]] bool stops(double eta, const Int3& twice, std::int64_t half_scale) const {
        return varies_ ? eta < at(twice, half_scale) : eta < threshold_;
    }

  private:
    [[nodiscard]] double at(const Int3& twice, std::int64_t half_scale) const;

    double threshold_;
    std::optional<Focus> focus_;
    std::optional<Camera> camera_;
    bool varies_;
    Double3 spacing_;
    Double3 origin_;
    double step_;   ///< how much smaller a face's ball is than a centre's, an edge's than a face's
    double reach_;  ///< of a centre's ball, per unit of scale
    double diagonal_;   ///< of a cell
    double pixel_ = 0;  ///< size of a pixel at distance 1
};

}  // namespace isonest::detail
