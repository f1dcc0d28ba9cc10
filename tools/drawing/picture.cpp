#include "tools/drawing/picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include <isonest/error.h>

#include "store/base/memory.h"
#include "store/base/vectors.h"
#include "store/base/workers.h"
#include "tools/drawing/canvas.h"
#include "tools/drawing/gl_canvas.h"
#include "tools/drawing/picture_frame.h"

namespace isonest::detail::cli {
namespace {

constexpr int kSupersampling = 2;  // per axis
constexpr int kTile = 32;          // rows

/// Heap of OSMesa, its compiler, one batch of triangles and the letters: measured by
/// tools/bench/peak_heap.cpp, rounded up.
constexpr std::uint64_t kOsMesaHeap = std::uint64_t{84} << 20U;
/// Bytes per pixel of the picture, for drawing and for writing it.
constexpr std::uint64_t kHeapPerPixel =
    kSupersampling * kSupersampling * GlCanvas::kHeapPerPixel + 3 + 4;

using Float3 = std::array<float, 3>;

Double3 plus(const Double3& a, const Double3& b, double times) {
    return {a[0] + times * b[0], a[1] + times * b[1], a[2] + times * b[2]};
}
Double3 minus(const Double3& a, const Double3& b) {
    return plus(a, b, -1);
}

/// The direction of `a`; toward the eye if `a` is zero.
Double3 unit_or_front(const Double3& a) {
    const double length = std::hypot(a[0], a[1], a[2]);
    return length > 0 ? Double3{a[0] / length, a[1] / length, a[2] / length} : Double3{0, 0, 1};
}

/// Calls f(i) for i = 0 .. count - 1 as one phase.
template <class F>
void in_steps(Progress& progress, const char* phase, const char* unit_name, std::uint64_t count,
              const F& f) {
    constexpr std::uint64_t kStep = 65536;
    progress.begin(phase, count, unit_name);
    for (std::uint64_t begin = 0; begin < count; begin += kStep) {
        progress.check();
        const std::uint64_t end = std::min(begin + kStep, count);
        for (std::uint64_t i = begin; i < end; ++i) {
            f(i);
        }
        progress.advance(end - begin);
    }
}

/// The colours of the vertices.
class VertexColors {
  public:
    VertexColors(const PlyMesh& mesh, const PictureOptions& o, Progress& progress)
        : mesh_(mesh), map_(o.colors, "--colors") {
        if (!o.by_values || mesh.vertices() == 0) {
            return;
        }
        of_vertices_ = mesh.has_colors();
        if (of_vertices_ || !mesh.has_values()) {
            return;
        }
        range_ = o.range;
        if (!range_) {
            constexpr double kInfinity = std::numeric_limits<double>::infinity();
            range_ = {kInfinity, -kInfinity};
            in_steps(progress, "measure", "vertices", mesh.vertices(), [&](std::uint64_t i) {
                const double v = mesh.value(i);
                if (std::isfinite(v)) {
                    range_->first = std::min(range_->first, v);
                    range_->second = std::max(range_->second, v);
                }
            });
            // A single value gives no colours.
            if (!(range_->first < range_->second)) {
                range_.reset();
            }
        }
    }
    [[nodiscard]] bool any() const { return of_vertices_ || range_.has_value(); }
    [[nodiscard]] const std::optional<std::pair<double, double>>& range() const { return range_; }
    [[nodiscard]] const ColorMap& map() const { return map_; }
    [[nodiscard]] Float3 of(std::uint64_t vertex) const {
        Float3 result{};
        if (of_vertices_) {
            const std::array<std::uint8_t, 3> rgb = mesh_.color(vertex);
            for (std::size_t c = 0; c < 3; ++c) {
                result.at(c) = static_cast<float>(rgb.at(c)) / 255;
            }
        } else if (range_) {
            const double v = mesh_.value(vertex);
            const Rgb rgb = std::isfinite(v)
                                ? map_.color((v - range_->first) / (range_->second - range_->first))
                                : Rgb{128, 128, 128};
            for (std::size_t c = 0; c < 3; ++c) {
                result.at(c) = static_cast<float>(rgb.at(c) / 255);
            }
        }
        return result;
    }

  private:
    const PlyMesh& mesh_;
    ColorMap map_;
    bool of_vertices_ = false;
    std::optional<std::pair<double, double>> range_;
};

/// One normal per vertex: the sum over its triangles, weighted by area; in picture axes.
std::vector<Float3> vertex_normals(const PlyMesh& mesh, const PictureCamera& camera,
                                   Progress& progress) {
    std::vector<Float3> normals(mesh.vertices());
    in_steps(progress, "normals", "triangles", mesh.triangles(), [&](std::uint64_t i) {
        const std::array<std::uint32_t, 3> t = mesh.triangle(i);
        const Double3 a = camera.place(mesh.vertex(t[0]));
        const Double3 n = cross(minus(camera.place(mesh.vertex(t[1])), a),
                                minus(camera.place(mesh.vertex(t[2])), a));
        for (const std::uint32_t v : t) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                normals[v].at(axis) += static_cast<float>(n.at(axis));
            }
        }
    });
    return normals;
}

/// Without `normals`, each triangle has its own.
void draw_triangles(const PlyMesh& mesh, const PictureCamera& camera,
                    const std::vector<Float3>& normals, const VertexColors& colors,
                    TriangleBatch& batch, Progress& progress) {
    in_steps(progress, "draw", "triangles", mesh.triangles(), [&](std::uint64_t i) {
        const std::array<std::uint32_t, 3> t = mesh.triangle(i);
        std::array<Double3, 3> p{};
        for (std::size_t c = 0; c < 3; ++c) {
            p.at(c) = camera.place(mesh.vertex(t.at(c)));
        }
        const Double3 flat = unit_or_front(cross(minus(p[1], p[0]), minus(p[2], p[0])));
        for (std::size_t c = 0; c < 3; ++c) {
            const Float3 color = colors.any() ? colors.of(t.at(c)) : Float3{};
            if (normals.empty()) {
                batch.add(p.at(c), flat, color);
            } else {
                const Float3& n = normals[t.at(c)];
                batch.add(p.at(c), unit_or_front({n[0], n[1], n[2]}), color);
            }
        }
        if (batch.full()) {
            batch.draw();
        }
    });
    batch.draw();
}

void check(const std::vector<PictureView>& views, const PictureOptions& o) {
    if (o.width < 1 || o.height < 1 || o.width > kMaxPixels || o.height > kMaxPixels) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("size {}x{}: give 1 to {} pixels per side", o.width, o.height, kMaxPixels));
    }
    for (const PictureView& v : views) {
        const double length = std::hypot(v.view[0], v.view[1], v.view[2]);
        if (!(length > 0) || !std::isfinite(length)) {
            throw Error(ErrorKind::invalid_argument,
                        "view: give the direction from the mesh toward the eye, not zero");
        }
    }
}

/// Cameras with the same scale. If there are several, each looks at the centre of the mesh.
std::vector<PictureCamera> fitted(const PlyMesh& mesh, const std::vector<PictureView>& views,
                                  PictureReport& report, Progress& progress) {
    std::vector<PictureCamera> cameras;
    std::vector<Bounds> turned(views.size());
    Bounds world;
    world.start();
    for (std::size_t k = 0; k < views.size(); ++k) {
        cameras.emplace_back(views[k].view);
        turned[k].start();
    }
    if (mesh.vertices() == 0) {
        return cameras;
    }
    in_steps(progress, "measure", "vertices", mesh.vertices(), [&](std::uint64_t i) {
        const Double3 p = mesh.vertex(i);
        world.add(p);
        for (std::size_t k = 0; k < views.size(); ++k) {
            turned[k].add(cameras[k].turn(p));
        }
    });
    report.lo = world.lo;
    report.hi = world.hi;
    if (views.size() > 1) {
        Double3 middle{};
        for (std::size_t a = 0; a < 3; ++a) {
            middle.at(a) = world.lo.at(a) / 2 + world.hi.at(a) / 2;
        }
        Double3 half{};
        for (std::size_t k = 0; k < views.size(); ++k) {
            const Double3 c = cameras[k].turn(middle);
            for (std::size_t a = 0; a < 3; ++a) {
                half.at(a) = std::max(
                    {half.at(a), turned[k].hi.at(a) - c.at(a), c.at(a) - turned[k].lo.at(a)});
            }
        }
        for (std::size_t k = 0; k < views.size(); ++k) {
            const Double3 c = cameras[k].turn(middle);
            turned[k] = {minus(c, half), plus(c, half, 1)};
        }
    }
    for (std::size_t k = 0; k < views.size(); ++k) {
        cameras[k].fit(turned[k]);
    }
    return cameras;
}

constexpr double kBarLetters = 7.5;  ///< width of the colour bar, in letters

double letter_size(const PictureOptions& o) {
    constexpr double kLetters = 50;  // per side of the picture
    return std::max(std::min(o.width, o.height) / kLetters, 9.0);
}

/// Draws the annotations into the picture.
void draw_notes(Canvas& canvas, const PictureOptions& o, const PictureCamera& camera,
                const Half& half, const VertexColors& colors) {
    const double size = letter_size(o);
    const double pixels_per_unit = camera.scale() * o.width / (2 * half.x);
    draw_directions(canvas, 4 * size, o.height - 4 * size, 2.6 * size, camera.right(), camera.up(),
                    size);
    draw_scale_bar(canvas, 9 * size, o.height - 1.6 * size, o.width / 5.0, pixels_per_unit, size);
    if (colors.range()) {
        const double left = o.width - (kBarLetters - 0.5) * size;
        draw_color_bar(canvas, {left, o.height * 0.25, left + 1.2 * size, o.height * 0.75},
                       colors.map(), colors.range()->first, colors.range()->second, {}, size);
    }
}

/// Radius of the search for hollows, in pixels of the picture; 0: none.
int radius_of(const PictureOptions& o) {
    constexpr double kPart = 0.06;
    constexpr int kMax = 64;
    return o.plain
               ? 0
               : std::min(static_cast<int>(std::lround(kPart * std::min(o.width, o.height))), kMax);
}

/// One thread per core, or a single one if the system refuses them.
int threads_there_are() {
    const int count = Workers::count_of(0);
    try {
        require_threads(count);
    } catch (const Error&) {
        return 1;
    }
    return count;
}

}  // namespace

PictureReport draw_pictures(const PlyMesh& mesh, const std::vector<PictureView>& views,
                            const PictureOptions& o, Progress& progress) {
    check(views, o);
    PictureReport report;
    const std::vector<PictureCamera> cameras = fitted(mesh, views, report, progress);
    const VertexColors colors(mesh, o, progress);
    report.range = colors.range();

    // Whole strips of tiles, as many as fit beside the normals, with the rows that darken their
    // hollows.
    const int radius = radius_of(o);
    const auto row_heap = static_cast<std::uint64_t>(o.width) * kHeapPerPixel;
    const std::uint64_t fixed =
        kLibraryHeap + kOsMesaHeap + row_heap * 2 * static_cast<std::uint64_t>(radius);
    const std::uint64_t least = fixed + row_heap * kTile;
    require_memory(views.front().png.string(), o.memory, least,
                   fmt::format("a picture {} pixels wide", o.width),
                   {{RemedyKind::smaller_picture}});
    const std::uint64_t normal_heap = mesh.vertices() * sizeof(Float3);
    report.smooth = !o.flat && normal_heap <= o.memory - least;
    const std::uint64_t fit =
        (o.memory - fixed - (report.smooth ? normal_heap : 0)) / row_heap / kTile * kTile;
    const int rows =
        static_cast<int>(std::min<std::uint64_t>(fit, static_cast<std::uint64_t>(o.height)));
    const bool noted = !o.plain && std::min(o.width, o.height) >= kMinNoted && mesh.triangles() > 0;

    const int threads = threads_there_are();
    GlCanvas canvas(o.width * kSupersampling, (rows + 2 * radius) * kSupersampling);
    TriangleBatch batch({o.color, colors.any(), o.wireframe});
    for (std::size_t k = 0; k < views.size(); ++k) {
        const PictureCamera& camera = cameras[k];
        const Half half = half_of(camera, o.width, o.height,
                                  noted && colors.range() ? kBarLetters * letter_size(o) : 0);
        const std::vector<Float3> normals =
            report.smooth ? vertex_normals(mesh, camera, progress) : std::vector<Float3>();
        PngFile file(views[k].png, o.width, o.height);
        for (int row = 0; row < o.height; row += rows) {
            canvas.show((row - radius) * kSupersampling, o.height * kSupersampling, half);
            batch.start();
            draw_triangles(mesh, camera, normals, colors, batch, progress);
            if (radius > 0) {
                canvas.darken_hollows(radius * kSupersampling, half, threads);
            }
            const int count = std::min(rows, o.height - row);
            std::vector<std::uint8_t> rgb = canvas.reduced(kSupersampling, radius, count);
            if (noted) {
                draw_over(rgb, o.width, row, count,
                          [&](Canvas& over) { draw_notes(over, o, camera, half, colors); });
            }
            file.write(rgb);
        }
        file.finish();
    }
    return report;
}

}  // namespace isonest::detail::cli
