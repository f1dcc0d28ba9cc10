#include "tools/drawing/slice_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

#include "store/base/vectors.h"
#include "store/files/output_file.h"

namespace isonest::detail::cli {
namespace {

int first(double at) {
    return static_cast<int>(std::clamp(at - 1, 0.0, 1e6));
}
int last(double at, int size) {
    return static_cast<int>(std::clamp(at + 1, -1.0, static_cast<double>(size - 1)));
}

}  // namespace

SliceRaster::SliceRaster(const SliceInk& ink, int width, int first_row, int rows)
    : ink_(ink),
      width_(width * kStep),
      begin_(first_row * kStep),
      end_((first_row + rows) * kStep),
      pixels_(std::size_t{3} * static_cast<std::size_t>(width_) *
                  static_cast<std::size_t>(end_ - begin_),
              std::uint8_t{255}) {}

void SliceRaster::draw(const std::array<Flat, 3>& t) {
    const double area =
        (t[1].x - t[0].x) * (t[2].y - t[0].y) - (t[1].y - t[0].y) * (t[2].x - t[0].x);
    if (area == 0 || !std::isfinite(area)) {
        return;
    }
    const auto [x0, x1] = std::minmax({t[0].x, t[1].x, t[2].x});
    const auto [y0, y1] = std::minmax({t[0].y, t[1].y, t[2].y});
    if (!(y0 - 1 <= end_ && y1 + 1 >= begin_)) {
        return;
    }
    std::array<double, 3> edge_length{};
    for (std::size_t i = 0; i < 3; ++i) {
        const Flat& a = t[(i + 1) % 3];
        const Flat& b = t[(i + 2) % 3];
        edge_length[i] = std::hypot(b.x - a.x, b.y - a.y);
    }
    const double slope_x = ((t[1].value - t[0].value) * (t[2].y - t[0].y) -
                            (t[2].value - t[0].value) * (t[1].y - t[0].y)) /
                           area;
    const double slope_y = ((t[2].value - t[0].value) * (t[1].x - t[0].x) -
                            (t[1].value - t[0].value) * (t[2].x - t[0].x)) /
                           area;
    const double slope = std::hypot(slope_x, slope_y);
    for (int y = std::max(first(y0), begin_); y <= last(y1, end_); ++y) {
        for (int x = first(x0); x <= last(x1, width_); ++x) {
            std::array<double, 3> w{};
            double to_edge = std::numeric_limits<double>::infinity();
            double value = 0;
            for (std::size_t i = 0; i < 3; ++i) {
                const Flat& a = t[(i + 1) % 3];
                const Flat& b = t[(i + 2) % 3];
                w[i] = ((b.x - a.x) * (y + 0.5 - a.y) - (b.y - a.y) * (x + 0.5 - a.x)) / area;
                to_edge = std::min(to_edge, w[i] * std::fabs(area) / edge_length[i]);
                value += w[i] * t[i].value;
            }
            if (std::min({w[0], w[1], w[2]}) >= -1e-9) {
                put(x, y, shade(value, to_edge, slope));
            }
        }
    }
}

std::vector<std::uint8_t> SliceRaster::reduced() const {
    std::vector<std::uint8_t> rgb;
    rgb.reserve(pixels_.size() / (kStep * kStep));
    for (int y = begin_; y < end_; y += kStep) {
        for (int x = 0; x < width_; x += kStep) {
            for (std::size_t c = 0; c < 3; ++c) {
                int sum = kStep * kStep / 2;
                for (int i = 0; i < kStep * kStep; ++i) {
                    sum += pixels_[place(x + i % kStep, y + i / kStep) + c];
                }
                rgb.push_back(static_cast<std::uint8_t>(sum / (kStep * kStep)));
            }
        }
    }
    return rgb;
}

/// A contour line is dark with a white border, so that it is visible on every colour map.
Rgb SliceRaster::shade(double value, double to_edge, double slope) const {
    const double range = ink_.high - ink_.low;
    Rgb color = ink_.map.color(range > 0 ? (value - ink_.low) / range : 0.5);
    if (ink_.grid && to_edge < 0.3 * kStep) {
        for (double& c : color) {
            c *= 0.45;
        }
    }
    constexpr double kLine = 0.75;
    constexpr double kBorder = 1.6;
    double nearest = std::numeric_limits<double>::infinity();
    for (const double contour : ink_.contours) {
        nearest = std::min(nearest, std::fabs(value - contour));
    }
    if (slope > 0 && nearest <= kBorder * kStep * slope) {
        color = nearest <= kLine * kStep * slope ? Rgb{20, 20, 20} : Rgb{255, 255, 255};
    }
    return color;
}

void SliceRaster::put(int x, int y, const Rgb& color) {
    for (std::size_t c = 0; c < 3; ++c) {
        pixels_[place(x, y) + c] = static_cast<std::uint8_t>(std::lround(color.at(c)));
    }
}

ContourLabels::ContourLabels(const Rectangle& r, const std::vector<double>& contours)
    : r_(r), contours_(contours), places_(contours.size() * kCells * kCells) {}

void ContourLabels::add(const std::array<Flat, 3>& t) {
    for (std::size_t c = 0; c < contours_.size(); ++c) {
        const double v = contours_[c];
        std::array<std::array<double, 2>, 2> ends{};
        std::size_t count = 0;
        for (std::size_t i = 0; i < 3 && count < 2; ++i) {
            const Flat& a = t[i];
            const Flat& b = t[(i + 1) % 3];
            if ((a.value < v) != (b.value < v)) {
                const double s = (v - a.value) / (b.value - a.value);
                ends.at(count++) = {a.x + s * (b.x - a.x), a.y + s * (b.y - a.y)};
            }
        }
        if (count < 2) {
            continue;
        }
        ContourLabel label{(ends[0][0] + ends[1][0]) / 2, (ends[0][1] + ends[1][1]) / 2, 0, v};
        label.turn = std::atan2(ends[1][1] - ends[0][1], ends[1][0] - ends[0][0]);
        constexpr double kHalfTurn = 3.14159265358979;
        if (label.turn > kHalfTurn / 2) {
            label.turn -= kHalfTurn;
        } else if (label.turn <= -kHalfTurn / 2) {
            label.turn += kHalfTurn;
        }
        const double x = (label.x - r_.left) / (r_.right - r_.left) * kCells;
        const double y = (label.y - r_.top) / (r_.bottom - r_.top) * kCells;
        if (!(x >= 0 && x < kCells && y >= 0 && y < kCells)) {
            continue;
        }
        const auto cell = static_cast<std::size_t>(y) * kCells + static_cast<std::size_t>(x);
        std::optional<Place>& known = places_[c * kCells * kCells + cell];
        const double distance = std::hypot(x - std::floor(x) - 0.5, y - std::floor(y) - 0.5);
        if (!known || std::tie(distance, label.x, label.y) <
                          std::tie(known->distance, known->label.x, known->label.y)) {
            known = Place{label, distance};
        }
    }
}

std::vector<ContourLabel> ContourLabels::choose(double size) const {
    std::vector<ContourLabel> chosen;
    const double apart = 4 * size;
    const double far = 0.35 * std::hypot(r_.right - r_.left, r_.bottom - r_.top);
    for (std::size_t c = 0; c < contours_.size(); ++c) {
        const std::size_t before = chosen.size();
        for (std::size_t n = 0; n < kMaxEach; ++n) {
            // The place that is farthest from all chosen places, and from the border.
            const ContourLabel* best = nullptr;
            double largest = apart;
            for (std::size_t i = 0; i < kCells * kCells; ++i) {
                const std::optional<Place>& place = places_[c * kCells * kCells + i];
                if (!place) {
                    continue;
                }
                const ContourLabel& l = place->label;
                double free =
                    2 * std::min({l.x - r_.left, r_.right - l.x, l.y - r_.top, r_.bottom - l.y});
                bool is_near_own = false;
                for (std::size_t k = 0; k < chosen.size(); ++k) {
                    const double d = std::hypot(chosen[k].x - l.x, chosen[k].y - l.y);
                    free = std::min(free, d);
                    is_near_own = is_near_own || (k >= before && d < far);
                }
                if (!is_near_own && free > largest) {
                    largest = free;
                    best = &l;
                }
            }
            if (best == nullptr) {
                break;
            }
            chosen.push_back(*best);
        }
    }
    return chosen;
}

namespace {

/// The plane's coordinates, seen from the side that the normal points to.
class Plane {
  public:
    explicit Plane(const Double3& n) {
        const double size = std::hypot(n[0], n[1], n[2]);
        const Double3 out{n[0] / size, n[1] / size, n[2] / size};
        const Double3 up = std::fabs(out[2]) > 0.999 ? Double3{0, 1, 0} : Double3{0, 0, 1};
        right_ = cross(up, out);
        const double length = std::hypot(right_[0], right_[1], right_[2]);
        for (double& r : right_) {
            r /= length;
        }
        up_ = cross(out, right_);
    }
    [[nodiscard]] Flat of(const std::array<float, 3>& position, double value) const {
        const Double3 p{static_cast<double>(position[0]), static_cast<double>(position[1]),
                        static_cast<double>(position[2])};
        return {dot(p, right_), dot(p, up_), value};
    }

    [[nodiscard]] const Double3& right() const { return right_; }
    [[nodiscard]] const Double3& up() const { return up_; }

  private:
    Double3 right_{};
    Double3 up_{};
};

double letter_size(const SlicePictureOptions& o) {
    constexpr double kLetters = 57;  // per side of the picture
    return std::max(std::min(o.width, o.height) / kLetters, 9.0);
}

/// The axis from `low` to `high` along a direction in the world; the axes of the world have their
/// names and their own coordinates.
AxisText axis_along(const Double3& direction, double low, double high,
                    std::optional<LengthUnit> unit) {
    const std::string behind = unit ? fmt::format(", {}", symbol_of(*unit)) : "";
    for (std::size_t a = 0; a < 3; ++a) {
        if (std::fabs(direction.at(a)) > 1 - 1e-9) {
            const double sign = direction.at(a) > 0 ? 1 : -1;
            return {std::string(1, "xyz"[a]) + behind, sign * low, sign * high};
        }
    }
    return {fmt::format("distance along ({:.3g}, {:.3g}, {:.3g}){}", direction[0], direction[1],
                        direction[2], behind),
            low, high};
}

}  // namespace

SlicePicture::SlicePicture(std::filesystem::path png, SlicePictureOptions options)
    : path_(std::move(png)), options_(std::move(options)), map_(options_.colors, "--colors") {}

void SlicePicture::prepare(const MeshLayout& /*layout*/,
                           std::span<const std::filesystem::path> inputs) {
    check_output(path_, true, {inputs.begin(), inputs.end()});
}

void SlicePicture::begin(const MeshLayout& layout) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    file_.reset();
    file_ = std::make_unique<PngFile>(path_, options_.width, options_.height);
    value_ = *layout.find("value");
    unit_ = layout.unit;
    extent_ = {{kInfinity, kInfinity}, {-kInfinity, -kInfinity}};
    raster_.reset();
    labels_.reset();
    chosen_.clear();
    row_ = 0;
}

void SlicePicture::add_vertices(const VertexBatch& batch) {
    if (row_ > 0) {
        return;
    }
    const Plane plane(options_.normal);
    for (const auto& position : batch.positions) {
        const Flat p = plane.of(position, 0);
        extent_.low = {std::min(extent_.low[0], p.x), std::min(extent_.low[1], p.y)};
        extent_.high = {std::max(extent_.high[0], p.x), std::max(extent_.high[1], p.y)};
    }
}

bool SlicePicture::framed() const {
    return !options_.plain && std::min(options_.width, options_.height) >= kMinFramed;
}

Rectangle SlicePicture::place() const {
    constexpr double kPictureMargin = 0.01;
    Rectangle room{kPictureMargin * options_.width, kPictureMargin * options_.height,
                   (1 - kPictureMargin) * options_.width, (1 - kPictureMargin) * options_.height};
    if (framed()) {
        const double s = letter_size(options_);
        room = {6.2 * s, 1.5 * s, options_.width - 9 * s, options_.height - 4 * s};
    }
    const double x = std::max(extent_.high[0] - extent_.low[0], 1e-300);
    const double y = std::max(extent_.high[1] - extent_.low[1], 1e-300);
    const double scale = std::min((room.right - room.left) / x, (room.bottom - room.top) / y);
    const double middle_x = (room.left + room.right) / 2;
    const double middle_y = (room.top + room.bottom) / 2;
    return {middle_x - x * scale / 2, middle_y - y * scale / 2, middle_x + x * scale / 2,
            middle_y + y * scale / 2};
}

double SlicePicture::scale() const {
    const Rectangle r = place();
    const double x = extent_.high[0] - extent_.low[0];
    const double y = extent_.high[1] - extent_.low[1];
    return x > y ? (r.right - r.left) / x : (r.bottom - r.top) / std::max(y, 1e-300);
}

SliceRaster& SlicePicture::raster() {
    if (raster_ == nullptr) {
        const std::uint64_t fit = options_.memory / SliceRaster::row_heap(options_.width);
        const auto rest = static_cast<std::uint64_t>(options_.height - row_);
        raster_ = std::make_unique<SliceRaster>(
            SliceInk{map_, options_.low, options_.high, options_.grid, options_.contours},
            options_.width, row_, static_cast<int>(std::clamp<std::uint64_t>(fit, 1, rest)));
    }
    return *raster_;
}

void SlicePicture::add_elements(const ElementBatch& batch) {
    const Plane plane(options_.normal);
    const Rectangle r = place();
    const double pixels = scale();
    const auto corner = [&](std::uint32_t v) {
        const Flat p = plane.of(batch.nearby.positions[v], batch.nearby.number(v, value_));
        return Flat{r.left + (p.x - extent_.low[0]) * pixels,
                    r.bottom - (p.y - extent_.low[1]) * pixels, p.value};
    };
    const bool labelled = row_ == 0 && framed() && !options_.contours.empty();
    if (labelled && labels_ == nullptr) {
        labels_ = std::make_unique<ContourLabels>(r, options_.contours);
    }
    for (const auto& t : batch.nearby_corners) {
        std::array<Flat, 3> corners{corner(t[0]), corner(t[1]), corner(t[2])};
        if (labelled) {
            labels_->add(corners);
        }
        for (Flat& c : corners) {
            c.x *= SliceRaster::kStep;
            c.y *= SliceRaster::kStep;
        }
        raster().draw(corners);
    }
}

void SlicePicture::frame(Canvas& canvas) const {
    const double size = letter_size(options_);
    const Plane plane(options_.normal);
    const Rectangle r = place();
    draw_axes(canvas, r, axis_along(plane.right(), extent_.low[0], extent_.high[0], unit_),
              axis_along(plane.up(), extent_.low[1], extent_.high[1], unit_), size);
    const double left = options_.width - 7.6 * size;
    const double top = std::min(r.top, options_.height * 0.3);
    draw_color_bar(canvas,
                   {left, top, left + 1.3 * size, std::max(r.bottom, options_.height * 0.7)}, map_,
                   options_.low, options_.high, options_.contours, size);
    canvas.color({0.05, 0.05, 0.05});
    for (const ContourLabel& label : chosen_) {
        // Centres the letters on the line.
        const double down = 0.35 * size;
        canvas.text_on_picture(label.x - down * std::sin(label.turn),
                               label.y + down * std::cos(label.turn), tick_text(label.value), size,
                               0.5, label.turn);
    }
}

bool SlicePicture::again() {
    std::vector<std::uint8_t> rgb = raster().reduced();
    if (labels_ != nullptr) {
        chosen_ = labels_->choose(letter_size(options_));
        labels_.reset();
    }
    if (framed() && extent_.low[0] <= extent_.high[0]) {
        draw_over(rgb, options_.width, row_, raster().rows(),
                  [&](Canvas& canvas) { frame(canvas); });
    }
    file_->write(rgb);
    row_ += raster().rows();
    raster_.reset();
    return row_ < options_.height;
}

void SlicePicture::end() {
    file_->finish();
    file_.reset();
}

}  // namespace isonest::detail::cli
