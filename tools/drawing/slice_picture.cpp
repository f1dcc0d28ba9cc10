// Rasterisation by edge functions: J. Pineda, "A parallel algorithm for polygon rasterization",
// SIGGRAPH 1988. Colours of viridis: S. van der Walt, N. Smith (2015), matplotlib, CC0.
#include "tools/drawing/slice_picture.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include <isonest/error.h>

#include "store/files/output_file.h"

namespace isonest::detail::cli {

using Rgb = std::array<double, 3>;
struct ColorMap {
    std::string name;
    std::vector<Rgb> colors;  ///< at equal distances
};

namespace {

const std::vector<ColorMap>& color_maps() {
    static const std::vector<ColorMap> maps{
        {"viridis",
         {{68, 1, 84},
          {72, 40, 120},
          {62, 74, 137},
          {49, 104, 142},
          {38, 130, 142},
          {31, 158, 137},
          {53, 183, 121},
          {110, 206, 88},
          {181, 222, 43},
          {253, 231, 37}}},
        {"gray", {{0, 0, 0}, {255, 255, 255}}},
        {"blue-red", {{59, 76, 192}, {221, 221, 221}, {180, 4, 38}}},
    };
    return maps;
}

Rgb color_of(const ColorMap& map, double t) {
    const double at = std::clamp(t, 0.0, 1.0) * static_cast<double>(map.colors.size() - 1);
    const auto i = std::min(static_cast<std::size_t>(at), map.colors.size() - 2);
    const double rest = at - static_cast<double>(i);
    Rgb out{};
    for (std::size_t c = 0; c < 3; ++c) {
        out[c] = map.colors[i][c] + rest * (map.colors[i + 1][c] - map.colors[i][c]);
    }
    return out;
}

struct Flat {
    double x = 0;
    double y = 0;
    double value = 0;
};

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

}  // namespace

/// Some rows of the picture, from `first_row` on, at `kStep` times its size per axis.
class Raster {
  public:
    static constexpr int kStep = 2;
    Raster(const SlicePictureOptions& o, const ColorMap& map, int first_row, int rows)
        : options_(o),
          map_(map),
          width_(o.width * kStep),
          begin_(first_row * kStep),
          end_((first_row + rows) * kStep),
          pixels_(std::size_t{3} * static_cast<std::size_t>(width_) *
                      static_cast<std::size_t>(end_ - begin_),
                  std::uint8_t{255}) {}
    [[nodiscard]] int rows() const { return (end_ - begin_) / kStep; }
    /// Bytes of a row, reduced() included.
    static std::uint64_t row_heap(int width) {
        return std::uint64_t{3} * static_cast<std::uint64_t>(width) * (kStep * kStep + 1);
    }

    /// Corners in pixels of the whole picture at that size, y down.
    void draw(const std::array<Flat, 3>& t) {
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

    [[nodiscard]] std::vector<std::uint8_t> reduced() const {
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

  private:
    static int first(double at) { return static_cast<int>(std::clamp(at - 1, 0.0, 1e6)); }
    static int last(double at, int size) {
        return static_cast<int>(std::clamp(at + 1, -1.0, static_cast<double>(size - 1)));
    }
    [[nodiscard]] std::size_t place(int x, int y) const {
        return 3 * (static_cast<std::size_t>(y - begin_) * static_cast<std::size_t>(width_) +
                    static_cast<std::size_t>(x));
    }
    [[nodiscard]] Rgb shade(double value, double to_edge, double slope) const {
        const double range = options_.high - options_.low;
        Rgb color = color_of(map_, range > 0 ? (value - options_.low) / range : 0.5);
        if (options_.grid && to_edge < 0.3 * kStep) {
            for (double& c : color) {
                c *= 0.45;
            }
        }
        for (const double contour : options_.contours) {
            if (std::fabs(value - contour) <= 0.6 * kStep * slope && slope > 0) {
                color = {255, 255, 255};
            }
        }
        return color;
    }
    void put(int x, int y, const Rgb& color) {
        for (std::size_t c = 0; c < 3; ++c) {
            pixels_[place(x, y) + c] = static_cast<std::uint8_t>(std::lround(color[c]));
        }
    }

    const SlicePictureOptions& options_;
    const ColorMap& map_;
    int width_;
    int begin_;  ///< rows of pixels
    int end_;
    std::vector<std::uint8_t> pixels_;
};

const std::vector<std::string>& color_map_names() {
    static const std::vector<std::string> names = [] {
        std::vector<std::string> all;
        for (const ColorMap& map : color_maps()) {
            all.push_back(map.name);
        }
        return all;
    }();
    return names;
}

SlicePicture::SlicePicture(std::filesystem::path png, SlicePictureOptions options)
    : path_(std::move(png)), options_(std::move(options)) {
    const auto map = std::find_if(color_maps().begin(), color_maps().end(),
                                  [&](const ColorMap& m) { return m.name == options_.colors; });
    if (map == color_maps().end()) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("--colors '{}': there are {}", options_.colors,
                                fmt::join(color_map_names(), ", ")));
    }
    map_ = &*map;
}

SlicePicture::~SlicePicture() = default;

void SlicePicture::prepare(const MeshLayout& /*layout*/,
                           std::span<const std::filesystem::path> inputs) {
    check_output(path_, true, {inputs.begin(), inputs.end()});
}

void SlicePicture::begin(const MeshLayout& layout) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    file_.reset();
    file_ = std::make_unique<PngFile>(path_, options_.width, options_.height);
    value_ = *layout.find("value");
    extent_ = {{kInfinity, kInfinity}, {-kInfinity, -kInfinity}};
    raster_.reset();
    row_ = 0;
}

void SlicePicture::vertices(const VertexBatch& batch) {
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

Raster& SlicePicture::raster() {
    if (raster_ == nullptr) {
        const std::uint64_t fit = options_.memory / Raster::row_heap(options_.width);
        const auto rest = static_cast<std::uint64_t>(options_.height - row_);
        raster_ = std::make_unique<Raster>(
            options_, *map_, row_, static_cast<int>(std::clamp<std::uint64_t>(fit, 1, rest)));
    }
    return *raster_;
}

void SlicePicture::elements(const ElementBatch& batch) {
    constexpr double kFilled = 0.98;
    const Plane plane(options_.normal);
    const auto& low = extent_.low;
    const auto& high = extent_.high;
    const double w = options_.width * Raster::kStep;
    const double h = options_.height * Raster::kStep;
    const double scale = kFilled * std::min(w / std::max(high[0] - low[0], 1e-300),
                                            h / std::max(high[1] - low[1], 1e-300));
    const auto corner = [&](std::uint32_t v) {
        const Flat p = plane.of(batch.nearby.positions[v], batch.nearby.number(v, value_));
        return Flat{w / 2 + (p.x - (low[0] + high[0]) / 2) * scale,
                    h / 2 - (p.y - (low[1] + high[1]) / 2) * scale, p.value};
    };
    for (const auto& t : batch.nearby_corners) {
        raster().draw({corner(t[0]), corner(t[1]), corner(t[2])});
    }
}

bool SlicePicture::again() {
    file_->write(raster().reduced());
    row_ += raster().rows();
    raster_.reset();
    return row_ < options_.height;
}

void SlicePicture::end() {
    file_->finish();
    file_.reset();
}

}  // namespace isonest::detail::cli
