#include "tools/drawing/picture_camera.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "store/base/vector3.h"

namespace isonest::detail::cli {
namespace {

Double3 unit(const Double3& a) {
    const double length = std::hypot(a[0], a[1], a[2]);
    return {a[0] / length, a[1] / length, a[2] / length};
}

}  // namespace

void Bounds::start() {
    lo.fill(std::numeric_limits<double>::infinity());
    hi.fill(-std::numeric_limits<double>::infinity());
}

void Bounds::add(const Double3& p) {
    for (std::size_t i = 0; i < 3; ++i) {
        lo.at(i) = std::min(lo.at(i), p.at(i));
        hi.at(i) = std::max(hi.at(i), p.at(i));
    }
}

PictureCamera::PictureCamera(const Double3& view) : toward_eye_(unit(view)) {
    constexpr double kUpright = 0.999;
    const Double3 world_up =
        std::abs(toward_eye_[2]) > kUpright ? Double3{0, 1, 0} : Double3{0, 0, 1};
    right_ = unit(cross(world_up, toward_eye_));
    up_ = cross(toward_eye_, right_);
}

Double3 PictureCamera::turn(const Double3& p) const {
    return {dot(p, right_), dot(p, up_), dot(p, toward_eye_)};
}

void PictureCamera::fit(const Bounds& turned) {
    double longest = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        centre_.at(i) = turned.lo.at(i) / 2 + turned.hi.at(i) / 2;
        half_.at(i) = turned.hi.at(i) / 2 - turned.lo.at(i) / 2;
        longest = std::max(longest, half_.at(i));
    }
    scale_ = longest > 0 ? 1 / longest : 1;
}

Double3 PictureCamera::place(const Double3& p) const {
    const Double3 t = turn(p);
    return {(t[0] - centre_[0]) * scale_, (t[1] - centre_[1]) * scale_,
            (t[2] - centre_[2]) * scale_};
}

}  // namespace isonest::detail::cli
