#include "query/tolerance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace isonest {

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
    diagonal_ = std::hypot(spacing[0], spacing[1], spacing[2]);
    // From a centre to a face centre, from there to an edge midpoint, from there to a centre of half
    // the scale, and so on: (2 longest + diagonal / 2) (1 + 1/2 + 1/4 ...).
    reach_ = 4 * longest + diagonal_;
    if (camera_) {
        pixel_ = 2 * std::tan(camera_->field_of_view * std::numbers::pi / 360) /
                 static_cast<double>(camera_->height);
    }
}

double Tolerance::at(const Int3& twice, std::int64_t half_scale) const {
    const double scale = static_cast<double>(half_scale) / 2;
    const double radius = reach_ * scale;
    Double3 p{};
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<std::size_t>(axis);
        p[a] = origin_[a] + spacing_[a] * static_cast<double>(twice[axis]) / 2;
    }
    double threshold = threshold_;
    if (focus_) {
        Double3 away{};
        for (std::size_t a = 0; a < 3; ++a) {
            away[a] = std::max({focus_->lo[a] - p[a], p[a] - focus_->hi[a], 0.0});
        }
        const double distance = std::max(std::hypot(away[0], away[1], away[2]) - radius, 0.0);
        threshold *= 1 + focus_->falloff * distance;
    }
    if (camera_) {
        const Double3& eye = camera_->position;
        const double distance =
            std::hypot(p[0] - eye[0], p[1] - eye[1], p[2] - eye[2]) - radius;
        if (distance > 0 && 2 * scale * diagonal_ < camera_->pixels * pixel_ * distance) {
            return std::numeric_limits<double>::infinity();
        }
    }
    return threshold;
}

}  // namespace isonest
