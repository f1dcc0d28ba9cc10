#include "tools/drawing/picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <isonest/error.h>

#include "store/base/memory_budget.h"
#include "tools/drawing/osmesa.h"
#include "tools/drawing/png_writer.h"

namespace isonest::detail::cli {
namespace {

constexpr int kSupersampling = 2;  // per axis
constexpr double kMargin = 0.05;   // of the picture, on each side
constexpr std::size_t kBatchTriangles = 32768;
constexpr std::size_t kCorner = 6;  // floats: position, normal

/// Heap of OSMesa, its compiler and one batch of triangles, and of OSMesa's buffers and ours per
/// pixel of the picture: measured by tools/bench/peak_heap.cpp, rounded up.
constexpr std::uint64_t kOsMesaHeap = std::uint64_t{84} << 20U;
constexpr std::uint64_t kHeapPerPixel = 68;

using Float3 = std::array<float, 3>;

double dot(const Double3& a, const Double3& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
Double3 cross(const Double3& a, const Double3& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
Double3 minus(const Double3& a, const Double3& b) {
    return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
Double3 unit(const Double3& a) {
    const double length = std::hypot(a[0], a[1], a[2]);
    return {a[0] / length, a[1] / length, a[2] / length};
}
/// The direction of `a`; toward the eye if it has none.
Double3 unit_or_front(const Double3& a) {
    const double length = std::hypot(a[0], a[1], a[2]);
    return length > 0 ? unit(a) : Double3{0, 0, 1};
}

struct Bounds {
    Double3 lo{};
    Double3 hi{};
    void start() {
        lo.fill(std::numeric_limits<double>::infinity());
        hi.fill(-std::numeric_limits<double>::infinity());
    }
    void add(const Double3& p) {
        for (std::size_t i = 0; i < 3; ++i) {
            lo[i] = std::min(lo[i], p[i]);
            hi[i] = std::max(hi[i], p[i]);
        }
    }
};

/// World to picture: x to the right, y up, z toward the eye, the longest visible side 2.
class Camera {
  public:
    explicit Camera(const Double3& view) {
        toward_eye_ = unit(view);
        const Double3 world_up =
            std::abs(toward_eye_[2]) > 0.999 ? Double3{0, 1, 0} : Double3{0, 0, 1};
        right_ = unit(cross(world_up, toward_eye_));
        up_ = cross(toward_eye_, right_);
    }
    [[nodiscard]] Double3 turn(const Double3& p) const {
        return {dot(p, right_), dot(p, up_), dot(p, toward_eye_)};
    }
    void fit(const Bounds& turned) {
        double longest = 0;
        for (std::size_t i = 0; i < 3; ++i) {
            centre_[i] = turned.lo[i] / 2 + turned.hi[i] / 2;
            half_[i] = turned.hi[i] / 2 - turned.lo[i] / 2;
            longest = std::max(longest, half_[i]);
        }
        scale_ = longest > 0 ? 1 / longest : 1;
    }
    [[nodiscard]] Double3 place(const Double3& p) const {
        const Double3 t = turn(p);
        return {(t[0] - centre_[0]) * scale_, (t[1] - centre_[1]) * scale_,
                (t[2] - centre_[2]) * scale_};
    }
    [[nodiscard]] double half_extent(std::size_t axis) const { return half_[axis] * scale_; }

  private:
    Double3 toward_eye_{};
    Double3 right_{};
    Double3 up_{};
    Double3 centre_{};
    Double3 half_{};
    double scale_ = 1;
};

/// An off-screen OpenGL context that draws into its own pixels: some rows of the picture.
class Canvas {
  public:
    Canvas(int width, int height) : width_(width), height_(height) {
        constexpr std::array<int, 9> kAttributes{OSMESA_FORMAT,
                                                 OSMESA_RGBA,
                                                 OSMESA_DEPTH_BITS,
                                                 24,
                                                 OSMESA_PROFILE,
                                                 OSMESA_COMPAT_PROFILE,
                                                 0,
                                                 0,
                                                 0};
        context_.reset(osmesa().OSMesaCreateContextAttribs(kAttributes.data(), nullptr));
        pixels_.resize(std::size_t{4} * static_cast<std::size_t>(width) *
                       static_cast<std::size_t>(height));
        if (context_ == nullptr ||
            osmesa().OSMesaMakeCurrent(context_.get(), pixels_.data(), GL_UNSIGNED_BYTE, width,
                                       height) != GL_TRUE) {
            throw Error(ErrorKind::limit,
                        fmt::format("OSMesa cannot draw {} x {} pixels", width, height),
                        {{RemedyKind::smaller_picture}});
        }
        osmesa().OSMesaPixelStore(OSMESA_Y_UP, 0);  // rows from the top
    }
    /// What is drawn next is the rows from `row` on of a picture of this width and `all` rows.
    void show(int row, int all) const { osmesa().glViewport(0, row + height_ - all, width_, all); }
    /// Averages squares of `step` pixels; RGB, the first `rows` rows from the top.
    [[nodiscard]] std::vector<std::uint8_t> reduced(int step, int rows) const {
        osmesa().glFinish();
        const int width = width_ / step;
        const int height = rows / step;
        std::vector<std::uint8_t> rgb;
        rgb.reserve(std::size_t{3} * static_cast<std::size_t>(width) *
                    static_cast<std::size_t>(height));
        for (int y = 0; y < height; ++y) {
            for (int x = 0; x < width; ++x) {
                for (std::size_t channel = 0; channel < 3; ++channel) {
                    unsigned sum = 0;
                    for (int i = 0; i < step * step; ++i) {
                        const auto at = static_cast<std::size_t>(y * step + i / step) *
                                            static_cast<std::size_t>(width_) +
                                        static_cast<std::size_t>(x * step + i % step);
                        sum += pixels_[4 * at + channel];
                    }
                    const auto count = static_cast<unsigned>(step * step);
                    rgb.push_back(static_cast<std::uint8_t>((sum + count / 2) / count));
                }
            }
        }
        return rgb;
    }

  private:
    struct Destroy {
        void operator()(OSMesaContext c) const { osmesa().OSMesaDestroyContext(c); }
    };
    int width_;
    int height_;
    std::vector<std::uint8_t> pixels_;
    std::unique_ptr<std::remove_pointer_t<OSMesaContext>, Destroy> context_;
};

void light(unsigned name, const std::array<float, 4>& toward, float brightness) {
    const std::array<float, 4> diffuse{brightness, brightness, brightness, 1};
    const std::array<float, 4> none{0, 0, 0, 1};
    osmesa().glLightfv(name, GL_POSITION, toward.data());
    osmesa().glLightfv(name, GL_DIFFUSE, diffuse.data());
    osmesa().glLightfv(name, GL_AMBIENT, none.data());
    osmesa().glLightfv(name, GL_SPECULAR, none.data());
    osmesa().glEnable(name);
}

void set_up(const Camera& camera, const PictureOptions& o) {
    double half_x = std::max(camera.half_extent(0), 1e-3) * (1 + 2 * kMargin);
    double half_y = std::max(camera.half_extent(1), 1e-3) * (1 + 2 * kMargin);
    const double aspect = static_cast<double>(o.width) / o.height;
    half_x = std::max(half_x, half_y * aspect);
    half_y = half_x / aspect;
    osmesa().glMatrixMode(GL_PROJECTION);
    osmesa().glLoadIdentity();
    osmesa().glOrtho(-half_x, half_x, -half_y, half_y, -1.5, 1.5);
    osmesa().glMatrixMode(GL_MODELVIEW);
    osmesa().glLoadIdentity();

    constexpr float kBackground = 0.97F;
    osmesa().glClearColor(kBackground, kBackground, kBackground, 1);
    osmesa().glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    osmesa().glEnable(GL_DEPTH_TEST);
    osmesa().glDepthFunc(GL_LEQUAL);

    // The back, where values are larger, is warmer and paler than the front.
    std::array<float, 4> front{0, 0, 0, 1};
    std::array<float, 4> back{0.85F, 0.72F, 0.60F, 1};
    for (std::size_t i = 0; i < 3; ++i) {
        front[i] = static_cast<float>(o.color[i]) / 255;
        back[i] = 0.75F * back[i] + 0.25F * front[i];
    }
    osmesa().glMaterialfv(GL_FRONT, GL_AMBIENT_AND_DIFFUSE, front.data());
    osmesa().glMaterialfv(GL_BACK, GL_AMBIENT_AND_DIFFUSE, back.data());
    const std::array<float, 4> ambient{0.26F, 0.26F, 0.28F, 1};
    osmesa().glLightModelfv(GL_LIGHT_MODEL_AMBIENT, ambient.data());
    osmesa().glLightModeli(GL_LIGHT_MODEL_TWO_SIDE, GL_TRUE);
    light(GL_LIGHT0, {-0.45F, 0.65F, 0.9F, 0}, 0.8F);
    light(GL_LIGHT1, {0.8F, -0.1F, 0.5F, 0}, 0.2F);
    osmesa().glEnable(GL_NORMALIZE);
}

/// Collects triangles and draws them when there are many.
class Batch {
  public:
    explicit Batch(const PictureOptions& options) : wireframe_(options.wireframe) {
        corners_.reserve(kBatchTriangles * 3 * kCorner);
        for (std::size_t i = 0; i < 3; ++i) {
            line_[i] = 0.3F * static_cast<float>(options.color[i]) / 255;
        }
    }
    void add(const Double3& position, const Double3& normal) {
        for (const Double3& v : {position, normal}) {
            for (const double c : v) {
                corners_.push_back(static_cast<float>(c));
            }
        }
    }
    [[nodiscard]] bool full() const { return corners_.size() >= kBatchTriangles * 3 * kCorner; }
    void draw() {
        const auto count = static_cast<GLsizei>(corners_.size() / kCorner);
        constexpr auto kStride = static_cast<GLsizei>(kCorner * sizeof(float));
        osmesa().glEnableClientState(GL_VERTEX_ARRAY);
        osmesa().glEnableClientState(GL_NORMAL_ARRAY);
        osmesa().glVertexPointer(3, GL_FLOAT, kStride, corners_.data());
        osmesa().glNormalPointer(GL_FLOAT, kStride, corners_.data() + 3);
        osmesa().glEnable(GL_LIGHTING);
        if (wireframe_) {
            osmesa().glEnable(GL_POLYGON_OFFSET_FILL);
            osmesa().glPolygonOffset(1, 1);
        }
        osmesa().glDrawArrays(GL_TRIANGLES, 0, count);
        if (wireframe_) {
            osmesa().glDisable(GL_POLYGON_OFFSET_FILL);
            osmesa().glDisable(GL_LIGHTING);
            osmesa().glColor3fv(line_.data());
            osmesa().glLineWidth(1);
            osmesa().glPolygonMode(GL_FRONT_AND_BACK, GL_LINE);
            osmesa().glDrawArrays(GL_TRIANGLES, 0, count);
            osmesa().glPolygonMode(GL_FRONT_AND_BACK, GL_FILL);
        }
        corners_.clear();
    }

  private:
    bool wireframe_;
    Float3 line_{};
    std::vector<float> corners_;
};

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

/// One normal per vertex, the sum over its triangles weighted by their area; in picture axes.
std::vector<Float3> vertex_normals(const PlyMesh& mesh, const Camera& camera, Progress& progress) {
    std::vector<Float3> normals(mesh.vertices());
    in_steps(progress, "normals", "triangles", mesh.triangles(), [&](std::uint64_t i) {
        const std::array<std::uint32_t, 3> t = mesh.triangle(i);
        const Double3 a = camera.place(mesh.vertex(t[0]));
        const Double3 n = cross(minus(camera.place(mesh.vertex(t[1])), a),
                                minus(camera.place(mesh.vertex(t[2])), a));
        for (const std::uint32_t v : t) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                normals[v][axis] += static_cast<float>(n[axis]);
            }
        }
    });
    return normals;
}

/// Without `normals` each triangle has its own.
void draw_triangles(const PlyMesh& mesh, const Camera& camera, const std::vector<Float3>& normals,
                    Batch& batch, Progress& progress) {
    in_steps(progress, "draw", "triangles", mesh.triangles(), [&](std::uint64_t i) {
        const std::array<std::uint32_t, 3> t = mesh.triangle(i);
        std::array<Double3, 3> p{};
        for (std::size_t c = 0; c < 3; ++c) {
            p[c] = camera.place(mesh.vertex(t[c]));
        }
        const Double3 flat = unit_or_front(cross(minus(p[1], p[0]), minus(p[2], p[0])));
        for (std::size_t c = 0; c < 3; ++c) {
            if (normals.empty()) {
                batch.add(p[c], flat);
            } else {
                const Float3& n = normals[t[c]];
                batch.add(p[c], unit_or_front({n[0], n[1], n[2]}));
            }
        }
        if (batch.full()) {
            batch.draw();
        }
    });
    batch.draw();
}

}  // namespace

PictureReport draw_picture(const PlyMesh& mesh, const std::filesystem::path& png,
                           const PictureOptions& o, Progress& progress) {
    if (o.width < 1 || o.height < 1 || o.width > kMostPixels || o.height > kMostPixels) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("size {}x{}: give 1 to {} pixels per side", o.width, o.height,
                                kMostPixels));
    }
    const double length = std::hypot(o.view[0], o.view[1], o.view[2]);
    if (!(length > 0) || !std::isfinite(length)) {
        throw Error(ErrorKind::invalid_argument,
                    "view: give the direction from the mesh toward the eye, not zero");
    }

    Camera camera(o.view);
    PictureReport report;
    if (mesh.vertices() > 0) {
        Bounds world;
        Bounds turned;
        world.start();
        turned.start();
        in_steps(progress, "measure", "vertices", mesh.vertices(), [&](std::uint64_t i) {
            const Double3 p = mesh.vertex(i);
            world.add(p);
            turned.add(camera.turn(p));
        });
        camera.fit(turned);
        report.lo = world.lo;
        report.hi = world.hi;
    }
    // Whole strips of tiles, as many as fit beside the normals.
    constexpr int kTile = 32;
    const auto row_heap = static_cast<std::uint64_t>(o.width) * kHeapPerPixel;
    const std::uint64_t fixed = kLibraryHeap + kOsMesaHeap;
    const std::uint64_t least = fixed + row_heap * kTile;
    require_memory(png.string(), o.memory, least, fmt::format("a picture {} pixels wide", o.width),
                   {{RemedyKind::smaller_picture}});
    const std::uint64_t normal_heap = mesh.vertices() * sizeof(Float3);
    report.smooth = !o.flat && normal_heap <= o.memory - least;
    const std::vector<Float3> normals =
        report.smooth ? vertex_normals(mesh, camera, progress) : std::vector<Float3>();
    const std::uint64_t fit =
        (o.memory - fixed - (report.smooth ? normal_heap : 0)) / row_heap / kTile * kTile;
    const int rows =
        static_cast<int>(std::min<std::uint64_t>(fit, static_cast<std::uint64_t>(o.height)));

    const Canvas canvas(o.width * kSupersampling, rows * kSupersampling);
    PngFile file(png, o.width, o.height);
    Batch batch(o);
    for (int row = 0; row < o.height; row += rows) {
        canvas.show(row * kSupersampling, o.height * kSupersampling);
        set_up(camera, o);
        draw_triangles(mesh, camera, normals, batch, progress);
        file.write(canvas.reduced(kSupersampling, std::min(rows, o.height - row) * kSupersampling));
    }
    file.finish();
    return report;
}

}  // namespace isonest::detail::cli
