#include "query/traverse/tolerance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "store/base/hypot3.h"

namespace isonest::detail {

Tolerance::Tolerance(double threshold, const std::optional<Focus>& focus,
                     const std::optional<Camera>& camera, const Double3& spacing,
                     const Double3& origin)
    : threshold_(threshold),
      focus_(focus),
      camera_(camera),
      varies_(focus || camera),
      spacing_(spacing),
      origin_(origin) {
    const double longest = std::max({spacing[0], spacing[1], spacing[2]});
    diagonal_ = hypot3(spacing[0], spacing[1], spacing[2]);
    // From a centre to a face centre, from there to an edge midpoint (one step each), from there to
    // a centre of half the scale (half a diagonal), and so on: (2 steps + diagonal / 2) (1 + 1/2 +
    // 1/4
    // ...). A little more, so that rounding does not matter.
    constexpr double kMore = 1.01;
    step_ = kMore * longest;
    reach_ = 4 * step_ + kMore * diagonal_;
    if (camera_) {
        pixel_ = 2 * std::tan(camera_->field_of_view * std::numbers::pi / 360) /
                 static_cast<double>(camera_->height);
    }
}

double Tolerance::at(const Int3& twice, std::int64_t half_scale) const {
    const double scale = static_cast<double>(half_scale) / 2;
    Double3 p{};
    int odd = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        odd += static_cast<int>((twice[axis] / half_scale) & 1);
        p[a] = origin_[a] + spacing_[a] * static_cast<double>(twice[axis]) / 2;
    }
    const double radius = (reach_ - (3 - odd) * step_) * scale;
    double threshold = threshold_;
    if (focus_) {
        Double3 away{};
        for (std::size_t a = 0; a < 3; ++a) {
            away[a] = std::max({focus_->lo[a] - p[a], p[a] - focus_->hi[a], 0.0});
        }
        const double distance = std::max(hypot3(away[0], away[1], away[2]) - radius, 0.0);
        threshold *= 1 + focus_->falloff * distance;
    }
    if (camera_) {
        const Double3& eye = camera_->position;
        const double distance = hypot3(p[0] - eye[0], p[1] - eye[1], p[2] - eye[2]) - radius;
        if (distance > 0 && 2 * scale * diagonal_ < camera_->pixels * pixel_ * distance) {
            return std::numeric_limits<double>::infinity();
        }
    }
    return threshold;
}

}  // namespace isonest::detail
