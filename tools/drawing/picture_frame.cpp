#include "tools/drawing/picture_frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "store/base/vectors.h"

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

namespace {

constexpr Color kFrameInk{0.15, 0.15, 0.15};
constexpr double kUp = -1.5707963267948966;  // a quarter turn

/// The largest number 1, 2 or 5 times a power of ten that is at most `value`.
double round_below(double value) {
    const double ten = std::pow(10, std::floor(std::log10(value)));
    const double digit = value / ten;
    return ten * (digit >= 5 ? 5 : digit >= 2 ? 2 : 1);
}

}  // namespace

std::vector<double> round_ticks(double low, double high, int wanted) {
    std::vector<double> ticks;
    if (!(high > low) || !std::isfinite(high - low)) {
        return {low};
    }
    double step = round_below((high - low) / std::max(wanted, 1));
    constexpr double kTooMany = 1.8;
    while ((high - low) / step > kTooMany * wanted) {
        step = round_below(step * 2.5);
    }
    const double first = std::ceil(low / step - 1e-9);
    const double last = std::floor(high / step + 1e-9);
    constexpr double kMax = 50;
    const int more = static_cast<int>(std::min(last - first, kMax));
    for (int i = 0; i <= more; ++i) {
        ticks.push_back((first + i) * step);
    }
    return ticks;
}

std::string tick_text(double value) {
    return fmt::format("{:.6g}", std::fabs(value) < 1e-300 ? 0.0 : value);
}

void draw_axes(Canvas& canvas, const Rectangle& r, const AxisText& x, const AxisText& y,
               double size) {
    constexpr double kTick = 5;
    canvas.color(kFrameInk);
    canvas.line(r.left, r.top, r.right, r.top, 1);
    canvas.line(r.left, r.bottom, r.right, r.bottom, 1);
    canvas.line(r.left, r.top, r.left, r.bottom, 1);
    canvas.line(r.right, r.top, r.right, r.bottom, 1);
    const auto at = [](const AxisText& axis, double value, double from, double to) {
        return from + (value - axis.low) / (axis.high - axis.low) * (to - from);
    };
    const auto count = [&](double pixels, double each) {
        return static_cast<int>(std::clamp(pixels / each, 1.0, 8.0));
    };
    const auto ticks = [&](const AxisText& axis, int wanted) {
        return round_ticks(std::min(axis.low, axis.high), std::max(axis.low, axis.high), wanted);
    };
    if (x.low != x.high) {
        for (const double v : ticks(x, count(r.right - r.left, 7 * size))) {
            const double px = at(x, v, r.left, r.right);
            canvas.line(px, r.bottom, px, r.bottom + kTick, 1);
            canvas.text(px, r.bottom + kTick + 1.1 * size, tick_text(v), size, 0.5);
        }
    }
    if (y.low != y.high) {
        for (const double v : ticks(y, count(r.bottom - r.top, 4 * size))) {
            const double py = at(y, v, r.bottom, r.top);
            canvas.line(r.left - kTick, py, r.left, py, 1);
            canvas.text(r.left - kTick - 3, py + 0.35 * size, tick_text(v), size, 1);
        }
    }
    canvas.text((r.left + r.right) / 2, r.bottom + kTick + 2.5 * size, x.name, size, 0.5);
    canvas.text(r.left - kTick - 3.9 * size, (r.top + r.bottom) / 2, y.name, size, 0.5, kUp);
}

void draw_color_bar(Canvas& canvas, const Rectangle& r, const ColorMap& map, double low,
                    double high, const std::vector<double>& marks, double size) {
    const double height = r.bottom - r.top;
    constexpr int kBarSteps = 256;
    for (int i = 0; i < kBarSteps; ++i) {
        const Rgb c = map.color((i + 0.5) / kBarSteps);
        canvas.color({c[0] / 255, c[1] / 255, c[2] / 255});
        // Each area extends under the next one, so that there are no visible gaps.
        canvas.area(r.left, r.bottom - height * std::min(i + 2, kBarSteps) / kBarSteps, r.right,
                    r.bottom - height * i / kBarSteps);
    }
    canvas.color(kFrameInk);
    canvas.line(r.left, r.top, r.right, r.top, 1);
    canvas.line(r.left, r.bottom, r.right, r.bottom, 1);
    canvas.line(r.left, r.top, r.left, r.bottom, 1);
    canvas.line(r.right, r.top, r.right, r.bottom, 1);
    constexpr double kTick = 4;
    if (!(high > low)) {
        canvas.text(r.right + kTick + 3, (r.top + r.bottom) / 2 + 0.35 * size, tick_text(low), size,
                    0);
        return;
    }
    const auto at = [&](double v) { return r.bottom - (v - low) / (high - low) * height; };
    const int wanted = static_cast<int>(std::clamp(height / (4 * size), 1.0, 8.0));
    for (const double v : round_ticks(low, high, wanted)) {
        canvas.line(r.right, at(v), r.right + kTick, at(v), 1);
        canvas.text(r.right + kTick + 3, at(v) + 0.35 * size, tick_text(v), size, 0);
    }
    for (const double v : marks) {
        if (v >= low && v <= high) {
            canvas.line(r.left, at(v), r.right, at(v), 2);
        }
    }
}

void draw_scale_bar(Canvas& canvas, double x, double y, double most, double pixels_per_unit,
                    double size) {
    const double length = round_below(most / pixels_per_unit);
    const double pixels = length * pixels_per_unit;
    if (!(pixels > 1) || !std::isfinite(pixels)) {
        return;
    }
    canvas.color(kFrameInk);
    canvas.line(x, y, x + pixels, y, 2);
    canvas.line(x, y - 4, x, y + 4, 2);
    canvas.line(x + pixels, y - 4, x + pixels, y + 4, 2);
    canvas.text_on_picture(x + pixels / 2, y - 8, tick_text(length), size, 0.5);
}

void draw_directions(Canvas& canvas, double x, double y, double length, const Double3& right,
                     const Double3& up, double size) {
    constexpr std::array<Color, 3> kAxisColors{
        {{0.80, 0.20, 0.20}, {0.15, 0.55, 0.20}, {0.15, 0.30, 0.80}}};
    for (std::size_t a = 0; a < 3; ++a) {
        const double dx = right.at(a) * length;
        const double dy = -up.at(a) * length;
        canvas.color(kAxisColors.at(a));
        canvas.line(x, y, x + dx, y + dy, 2);
        // The name of an axis that points toward the eye is beside those of the others.
        const double reach = std::hypot(dx, dy);
        const double out = reach > 0.2 * length ? 1 + 0.7 * size / reach : 0;
        canvas.text_on_picture(x + dx * out + (out == 0 ? -0.8 * size : 0),
                               y + dy * out + (out == 0 ? 1.1 * size : 0.35 * size),
                               std::string(1, "xyz"[a]), size, 0.5);
    }
}

}  // namespace isonest::detail::cli
