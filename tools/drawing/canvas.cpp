#include "tools/drawing/canvas.h"

#include <cairo-svg.h>
#include <cairo.h>

#include <memory>

#include <isonest/error.h>

#include "store/files/output_file.h"

namespace isonest::detail::cli {
namespace {

/// Cairo's output, into a std::string.
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
    color({1, 1, 1});
    cairo_paint(context_);
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

void Canvas::dot(double x, double y) {
    cairo_arc(context_, x, y, 2.2, 0, 6.2832);
    cairo_fill(context_);
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

bool is_canvas(const std::filesystem::path& path) {
    return is_svg(path) || path.extension() == ".png";
}

void draw_canvas(const std::filesystem::path& path, int width, int height,
                 const std::function<void(Canvas&)>& draw) {
    if (!is_canvas(path)) {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    "a plot's name must end with .svg or .png");
    }
    std::string bytes;
    const std::unique_ptr<cairo_surface_t, decltype(&cairo_surface_destroy)> surface(
        is_svg(path) ? cairo_svg_surface_create_for_stream(&append, &bytes, width, height)
                     : cairo_image_surface_create(CAIRO_FORMAT_RGB24, width, height),
        cairo_surface_destroy);
    const std::unique_ptr<cairo_t, decltype(&cairo_destroy)> context(cairo_create(surface.get()),
                                                                     cairo_destroy);
    Canvas canvas(context.get());
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
