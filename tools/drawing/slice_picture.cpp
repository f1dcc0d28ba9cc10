#include "tools/drawing/slice_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "store/files/output_file.h"

namespace isonest::detail::cli {
namespace {

/// The plane's own coordinates, seen from where the normal points to.
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
    static double dot(const Double3& a, const Double3& b) {
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    }
    static Double3 cross(const Double3& a, const Double3& b) {
        return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    }
    Double3 right_{};
    Double3 up_{};
};

double letter_size(const SlicePictureOptions& o) {
    constexpr double kLetters = 57;  // of a picture's side
    return std::max(std::min(o.width, o.height) / kLetters, 9.0);
}

/// An axis of the picture from `low` to `high` along a direction of the world: one of the world's
/// axes has its name and its own numbers.
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
    return !options_.plain && std::min(options_.width, options_.height) >= kLeastFramed;
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
        // The middle of the letters is on the line.
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
