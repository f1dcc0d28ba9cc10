#include "tools/drawing/canvas.h"

#include <cairo-svg.h>
#include <cairo.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <png.h>
#include <strings.h>

#include <algorithm>
#include <csetjmp>
#include <cstring>
#include <exception>
#include <memory>
#include <string_view>

#include <isonest/error.h>

#include "store/files/output_file.h"

namespace isonest::detail::cli {
namespace {

struct Table {
    std::string_view name;
    std::string_view colors;  ///< six hexadecimal digits per colour
};

constexpr std::array<Table, 28> kTables{{
#include "tools/drawing/color_map_tables.inc"
}};

}  // namespace

std::vector<std::string> color_map_names() {
    std::vector<std::string> names;
    names.reserve(kTables.size());
    for (const Table& table : kTables) {
        names.emplace_back(table.name);
    }
    return names;
}

ColorMap::ColorMap(const std::string& name, const std::string& option) {
    const bool reversed = name.ends_with("_r");
    const std::string_view wanted =
        reversed ? std::string_view(name).substr(0, name.size() - 2) : std::string_view(name);
    const auto* const table = std::find_if(kTables.begin(), kTables.end(),
                                           [&](const Table& t) { return t.name == wanted; });
    if (table == kTables.end()) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} '{}': give one of {}; append _r to reverse it", option, name,
                                fmt::join(color_map_names(), ", ")));
    }
    constexpr std::size_t kDigits = 6;
    for (std::size_t at = 0; at < table->colors.size(); at += kDigits) {
        Rgb color{};
        for (std::size_t c = 0; c < 3; ++c) {
            color.at(c) = std::stoi(std::string(table->colors.substr(at + 2 * c, 2)), nullptr, 16);
        }
        colors_.push_back(color);
    }
    if (reversed) {
        std::reverse(colors_.begin(), colors_.end());
    }
}

Rgb ColorMap::color(double t) const {
    const double at = std::clamp(t, 0.0, 1.0) * static_cast<double>(colors_.size() - 1);
    const auto i = std::min(static_cast<std::size_t>(at), colors_.size() - 2);
    const double rest = at - static_cast<double>(i);
    Rgb out{};
    for (std::size_t c = 0; c < 3; ++c) {
        out.at(c) = colors_[i].at(c) + rest * (colors_[i + 1].at(c) - colors_[i].at(c));
    }
    return out;
}

struct PngFile::State {
    OutputFile file;
    std::uint64_t written = 0;
    std::exception_ptr failure;  ///< from writing the file, kept while libpng is on the stack
    png_structp png = nullptr;
    png_infop info = nullptr;

    explicit State(const std::filesystem::path& path) : file(path, true) {}
    State(const State&) = delete;
    State& operator=(const State&) = delete;
    ~State() { png_destroy_write_struct(&png, &info); }

    /// Writes bytes to the file; if that fails, returns false and `failure` says why.
    bool put(std::span<const std::byte> bytes) noexcept {
        try {
            file.write_at(written, bytes);
            written += bytes.size();
            return true;
        } catch (...) {
            failure = std::current_exception();
            return false;
        }
    }
    static void write(png_structp png, png_bytep data, png_size_t size) {
        if (!static_cast<State*>(png_get_io_ptr(png))->put(std::as_bytes(std::span(data, size)))) {
            png_error(png, "the file cannot be written");
        }
    }
};

namespace {

void no_warning(png_structp /*png*/, png_const_charp /*text*/) {}
void no_flush(png_structp /*png*/) {}

// libpng reports errors by longjmp(), so nothing here may have a destructor.
// NOLINTBEGIN(modernize-avoid-setjmp-longjmp,cert-err52-cpp)
bool begin(png_structp png, png_infop info, void* state, png_rw_ptr write, int width, int height) {
    if (png == nullptr || info == nullptr || setjmp(png_jmpbuf(png)) != 0) {
        return false;
    }
    png_set_write_fn(png, state, write, no_flush);
    png_set_IHDR(png, info, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height), 8,
                 PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    return true;
}

bool write_row(png_structp png, const std::uint8_t* row) {
    if (setjmp(png_jmpbuf(png)) != 0) {
        return false;
    }
    png_write_row(png, row);
    return true;
}

bool end(png_structp png) {
    if (setjmp(png_jmpbuf(png)) != 0) {
        return false;
    }
    png_write_end(png, nullptr);
    return true;
}
// NOLINTEND(modernize-avoid-setjmp-longjmp,cert-err52-cpp)

}  // namespace

bool is_png(const std::filesystem::path& path) {
    const std::string end = path.extension().string();
    return ::strcasecmp(end.c_str(), ".png") == 0;
}

PngFile::PngFile(const std::filesystem::path& path, int width, int height)
    : path_(path),
      row_bytes_(3 * static_cast<std::size_t>(width)),
      state_(std::make_unique<State>(path)) {
    state_->png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, no_warning);
    state_->info = state_->png != nullptr ? png_create_info_struct(state_->png) : nullptr;
    if (!begin(state_->png, state_->info, state_.get(), &State::write, width, height)) {
        fail();
    }
}

PngFile::~PngFile() = default;

void PngFile::fail() {
    if (state_->failure != nullptr) {
        std::rethrow_exception(state_->failure);
    }
    throw Error(ErrorKind::limit, {path_.string()}, "cannot be encoded as PNG");
}

void PngFile::write(std::span<const std::uint8_t> rgb) {
    for (std::size_t at = 0; at < rgb.size(); at += row_bytes_) {
        if (!write_row(state_->png, rgb.data() + at)) {
            fail();
        }
    }
}

void PngFile::finish() {
    if (!end(state_->png)) {
        fail();
    }
    state_->file.publish_as_named();
}

namespace {

/// Appends Cairo's output to a std::string.
cairo_status_t append(void* bytes, const unsigned char* data, unsigned length) {
    static_cast<std::string*>(bytes)->append(reinterpret_cast<const char*>(data), length);
    return CAIRO_STATUS_SUCCESS;
}

bool is_svg(const std::filesystem::path& path) {
    return path.extension() == ".svg";
}

}  // namespace

Canvas::Canvas(_cairo* context) : context_(context) {
    cairo_select_font_face(context_, "sans-serif", CAIRO_FONT_SLANT_NORMAL,
                           CAIRO_FONT_WEIGHT_NORMAL);
}

void Canvas::color(const Color& c) {
    cairo_set_source_rgb(context_, c[0], c[1], c[2]);
}

void Canvas::line(double x0, double y0, double x1, double y1, double width, bool dashed) {
    constexpr double kDash = 5;
    cairo_set_dash(context_, &kDash, dashed ? 1 : 0, 0);
    cairo_set_line_width(context_, width);
    cairo_move_to(context_, x0, y0);
    cairo_line_to(context_, x1, y1);
    cairo_stroke(context_);
}

void Canvas::area(double x0, double y0, double x1, double y1) {
    cairo_rectangle(context_, x0, y0, x1 - x0, y1 - y0);
    cairo_fill(context_);
}

void Canvas::path(const std::vector<std::array<double, 2>>& points, double width,
                  const std::vector<double>& dashes) {
    cairo_set_dash(context_, dashes.data(), static_cast<int>(dashes.size()), 0);
    cairo_set_line_width(context_, width);
    cairo_set_line_join(context_, CAIRO_LINE_JOIN_ROUND);
    cairo_new_path(context_);
    for (const auto& [x, y] : points) {
        cairo_line_to(context_, x, y);
    }
    cairo_stroke(context_);
}

void Canvas::marker(double x, double y, int kind) {
    constexpr double kHalf = 3.2;
    cairo_set_dash(context_, nullptr, 0, 0);
    cairo_set_line_width(context_, 1.5);
    cairo_new_path(context_);
    const auto polygon = [&](const std::vector<std::array<double, 2>>& corners) {
        for (const auto& [dx, dy] : corners) {
            cairo_line_to(context_, x + dx * kHalf, y + dy * kHalf);
        }
        cairo_fill(context_);
    };
    const auto strokes = [&](double dx0, double dy0, double dx1, double dy1) {
        cairo_move_to(context_, x - dx0 * kHalf, y - dy0 * kHalf);
        cairo_line_to(context_, x + dx0 * kHalf, y + dy0 * kHalf);
        cairo_move_to(context_, x - dx1 * kHalf, y - dy1 * kHalf);
        cairo_line_to(context_, x + dx1 * kHalf, y + dy1 * kHalf);
        cairo_stroke(context_);
    };
    switch (kind) {
        case 0:
            cairo_arc(context_, x, y, 0.85 * kHalf, 0, 6.2832);
            cairo_fill(context_);
            break;
        case 1:
            polygon({{-0.8, -0.8}, {0.8, -0.8}, {0.8, 0.8}, {-0.8, 0.8}});
            break;
        case 2:
            polygon({{0, -1.1}, {1, 0.8}, {-1, 0.8}});
            break;
        case 3:
            polygon({{0, -1.2}, {1.2, 0}, {0, 1.2}, {-1.2, 0}});
            break;
        case 4:
            strokes(0.9, 0.9, 0.9, -0.9);
            break;
        default:
            strokes(1.1, 0, 0, 1.1);
            break;
    }
}

void Canvas::text(double x, double y, const std::string& words, double size, double anchor,
                  double turn) {
    cairo_set_font_size(context_, size);
    cairo_text_extents_t extents{};
    cairo_text_extents(context_, words.c_str(), &extents);
    cairo_save(context_);
    cairo_translate(context_, x, y);
    cairo_rotate(context_, turn);
    cairo_move_to(context_, -anchor * extents.x_advance, 0);
    cairo_show_text(context_, words.c_str());
    cairo_restore(context_);
}

void Canvas::text_on_picture(double x, double y, const std::string& words, double size,
                             double anchor, double turn) {
    constexpr double kHalo = 3;
    cairo_save(context_);
    cairo_set_font_size(context_, size);
    cairo_translate(context_, x, y);
    cairo_rotate(context_, turn);
    cairo_move_to(context_, -anchor * width_of(words, size), 0);
    cairo_text_path(context_, words.c_str());
    cairo_path_t* const path = cairo_copy_path(context_);
    cairo_save(context_);
    cairo_set_source_rgb(context_, 1, 1, 1);
    cairo_set_line_width(context_, kHalo);
    cairo_set_line_join(context_, CAIRO_LINE_JOIN_ROUND);
    cairo_stroke(context_);
    cairo_restore(context_);
    cairo_append_path(context_, path);
    cairo_path_destroy(path);
    cairo_fill(context_);
    cairo_restore(context_);
}

double Canvas::width_of(const std::string& words, double size) {
    cairo_set_font_size(context_, size);
    cairo_text_extents_t extents{};
    cairo_text_extents(context_, words.c_str(), &extents);
    return extents.x_advance;
}

void draw_over(std::vector<std::uint8_t>& rgb, int width, int first_row, int rows,
               const std::function<void(Canvas&)>& draw) {
    const std::unique_ptr<cairo_surface_t, decltype(&cairo_surface_destroy)> surface(
        cairo_image_surface_create(CAIRO_FORMAT_RGB24, width, rows), cairo_surface_destroy);
    unsigned char* const pixels = cairo_image_surface_get_data(surface.get());
    if (pixels == nullptr) {
        throw Error(ErrorKind::io, "Cairo has no memory for the picture's frame");
    }
    const auto stride = static_cast<std::size_t>(cairo_image_surface_get_stride(surface.get()));
    const auto each_pixel = [&](const auto& f) {
        for (int y = 0; y < rows; ++y) {
            for (int x = 0; x < width; ++x) {
                const auto at = static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                                static_cast<std::size_t>(x);
                f(rgb.data() + 3 * at,
                  pixels + static_cast<std::size_t>(y) * stride + 4 * static_cast<std::size_t>(x));
            }
        }
    };
    // A pixel is a 32-bit number, 0x00RRGGBB.
    each_pixel([](const std::uint8_t* from, unsigned char* to) {
        const std::uint32_t pixel = static_cast<std::uint32_t>(from[0]) << 16U |
                                    static_cast<std::uint32_t>(from[1]) << 8U | from[2];
        std::memcpy(to, &pixel, sizeof(pixel));
    });
    cairo_surface_mark_dirty(surface.get());
    {
        const std::unique_ptr<cairo_t, decltype(&cairo_destroy)> context(
            cairo_create(surface.get()), cairo_destroy);
        cairo_translate(context.get(), 0, -first_row);
        Canvas canvas(context.get());
        draw(canvas);
    }
    cairo_surface_flush(surface.get());
    each_pixel([](std::uint8_t* to, const unsigned char* from) {
        std::uint32_t pixel = 0;
        std::memcpy(&pixel, from, sizeof(pixel));
        to[0] = static_cast<std::uint8_t>(pixel >> 16U);
        to[1] = static_cast<std::uint8_t>(pixel >> 8U);
        to[2] = static_cast<std::uint8_t>(pixel);
    });
}

bool is_canvas(const std::filesystem::path& path) {
    return is_svg(path) || path.extension() == ".png";
}

void draw_canvas(const std::filesystem::path& path, int width, int height,
                 const std::function<void(Canvas&)>& draw) {
    if (!is_canvas(path)) {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    "plots are written as .svg or .png");
    }
    std::string bytes;
    const std::unique_ptr<cairo_surface_t, decltype(&cairo_surface_destroy)> surface(
        is_svg(path) ? cairo_svg_surface_create_for_stream(&append, &bytes, width, height)
                     : cairo_image_surface_create(CAIRO_FORMAT_RGB24, width, height),
        cairo_surface_destroy);
    const std::unique_ptr<cairo_t, decltype(&cairo_destroy)> context(cairo_create(surface.get()),
                                                                     cairo_destroy);
    Canvas canvas(context.get());
    canvas.color({1, 1, 1});
    cairo_paint(context.get());
    draw(canvas);
    bool good = cairo_status(context.get()) == CAIRO_STATUS_SUCCESS;
    if (is_svg(path)) {
        cairo_surface_finish(surface.get());
        good = good && cairo_surface_status(surface.get()) == CAIRO_STATUS_SUCCESS;
    } else {
        good = good && cairo_surface_write_to_png_stream(surface.get(), &append, &bytes) ==
                           CAIRO_STATUS_SUCCESS;
    }
    if (!good) {
        throw Error(ErrorKind::io, {path.string()}, "cannot draw the plot");
    }
    OutputFile file(path, true);
    file.write_at(0, std::as_bytes(std::span(bytes)));
    file.publish_as_named();
}

}  // namespace isonest::detail::cli
