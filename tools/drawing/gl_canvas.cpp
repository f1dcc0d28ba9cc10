#include "tools/drawing/gl_canvas.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <string>

#include <isonest/error.h>

#include "store/base/memory.h"
#include "store/base/workers.h"
#include "tools/drawing/ambient_occlusion.h"

namespace isonest::detail {
namespace {

template <class Function>
void find(void* library, const char* name, Function& function) {
    function = reinterpret_cast<Function>(::dlsym(library, name));
    if (function == nullptr) {
        throw Error(ErrorKind::unsupported,
                    fmt::format("libOSMesa.so.8 has no {}: install Debian's libosmesa6", name));
    }
}

/// Mesa waits forever for drawing threads that the system refused to start.
void draw_without_threads_where_they_are_refused() {
    constexpr int kBesideThem = 4;
    try {
        require_threads(Workers::count_of(0) + kBesideThem);
    } catch (const Error&) {
        ::setenv("LP_NUM_THREADS", "0", 1);
    }
}

OsMesa load() {
    draw_without_threads_where_they_are_refused();
    void* const library = ::dlopen("libOSMesa.so.8", RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) {
        const std::string why = ::dlerror();
        throw_if_no_room_to_load({}, "libOSMesa, which draws pictures", why);
        throw Error(ErrorKind::unsupported,
                    fmt::format("pictures need libOSMesa: {}; install libosmesa6", why));
    }
    OsMesa functions;
#define ISONEST_OSMESA_FIND(name) find(library, #name, functions.name);
    ISONEST_OSMESA_FUNCTIONS(ISONEST_OSMESA_FIND)
#undef ISONEST_OSMESA_FIND
    return functions;
}

}  // namespace

const OsMesa& osmesa() {
    static const OsMesa functions = load();
    return functions;
}

}  // namespace isonest::detail

namespace isonest::detail::cli {
namespace {

constexpr double kMargin = 0.05;  // per side, relative to the picture
constexpr double kNear = -1.5;    // in the camera's z
constexpr double kFar = 1.5;
constexpr std::size_t kBatchTriangles = 32768;
constexpr std::size_t kCorner = 9;  // floats: position, normal, colour

void light(unsigned name, const std::array<float, 4>& toward, float brightness) {
    const std::array<float, 4> diffuse{brightness, brightness, brightness, 1};
    const std::array<float, 4> none{0, 0, 0, 1};
    osmesa().glLightfv(name, GL_POSITION, toward.data());
    osmesa().glLightfv(name, GL_DIFFUSE, diffuse.data());
    osmesa().glLightfv(name, GL_AMBIENT, none.data());
    osmesa().glLightfv(name, GL_SPECULAR, none.data());
    osmesa().glEnable(name);
}

}  // namespace

Half half_of(const PictureCamera& camera, int width, int height, double right) {
    Half half{std::max(camera.half_extent(0), 1e-3) * (1 + 2 * kMargin),
              std::max(camera.half_extent(1), 1e-3) * (1 + 2 * kMargin)};
    const double aspect = (width - right) / height;
    half.x = std::max(half.x, half.y * aspect);
    half.y = half.x / aspect;
    half.middle_x = half.x * right / (width - right);
    half.x += half.middle_x;
    return half;
}

GlCanvas::GlCanvas(int width, int height) : width_(width), height_(height) {
    constexpr std::array<int, 9> kAttributes{OSMESA_FORMAT,
                                             OSMESA_RGBA,
                                             OSMESA_DEPTH_BITS,
                                             24,
                                             OSMESA_PROFILE,
                                             OSMESA_COMPAT_PROFILE,
                                             0,
                                             0,
                                             0};
    // libOSMesa crashes if there is less memory. Measured: with LLVM 19 of Debian 13 it takes up to
    // 112 MB to load and start.
    require_free_heap(std::size_t{128} << 20U);
    context_.reset(osmesa().OSMesaCreateContextAttribs(kAttributes.data(), nullptr));
    const auto count = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    pixels_.resize(4 * count);
    depth_.resize(count);
    if (context_ == nullptr ||
        osmesa().OSMesaMakeCurrent(context_.get(), pixels_.data(), GL_UNSIGNED_BYTE, width,
                                   height) != GL_TRUE) {
        throw Error(ErrorKind::limit,
                    fmt::format("OSMesa cannot draw {} x {} pixels", width, height),
                    {{RemedyKind::smaller_picture}});
    }
    osmesa().OSMesaPixelStore(OSMESA_Y_UP, 0);  // rows from the top
}

void GlCanvas::show(int row, int all, const Half& half) const {
    const OsMesa& gl = osmesa();
    gl.glViewport(0, row + height_ - all, width_, all);
    gl.glMatrixMode(GL_PROJECTION);
    gl.glLoadIdentity();
    gl.glOrtho(half.middle_x - half.x, half.middle_x + half.x, -half.y, half.y, kNear, kFar);
    gl.glMatrixMode(GL_MODELVIEW);
    gl.glLoadIdentity();
    constexpr float kBackground = 0.97F;
    gl.glClearColor(kBackground, kBackground, kBackground, 1);
    gl.glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    gl.glEnable(GL_DEPTH_TEST);
    gl.glDepthFunc(GL_LEQUAL);
    // A strong light from the upper left, a weak one from the right.
    const std::array<float, 4> ambient{0.30F, 0.30F, 0.32F, 1};
    gl.glLightModelfv(GL_LIGHT_MODEL_AMBIENT, ambient.data());
    gl.glLightModeli(GL_LIGHT_MODEL_TWO_SIDE, GL_TRUE);
    light(GL_LIGHT0, {-0.45F, 0.65F, 0.9F, 0}, 0.72F);
    light(GL_LIGHT1, {0.8F, -0.1F, 0.5F, 0}, 0.2F);
    gl.glEnable(GL_NORMALIZE);
}

void GlCanvas::darken_hollows(double radius, const Half& half, int threads) {
    osmesa().glFinish();
    osmesa().glReadPixels(0, 0, width_, height_, GL_DEPTH_COMPONENT, GL_FLOAT, depth_.data());
    // OpenGL's rows begin at the bottom.
    const auto row = static_cast<std::size_t>(width_);
    for (std::size_t y = 0; y < static_cast<std::size_t>(height_) / 2; ++y) {
        std::swap_ranges(depth_.begin() + static_cast<std::ptrdiff_t>(y * row),
                         depth_.begin() + static_cast<std::ptrdiff_t>((y + 1) * row),
                         depth_.end() - static_cast<std::ptrdiff_t>((y + 1) * row));
    }
    const double pixels = (kFar - kNear) * width_ / (2 * half.x);
    Workers(threads).execute([&] {
        cli::darken_hollows({depth_, width_, height_, pixels}, radius, 0, height_, pixels_);
    });
}

std::vector<std::uint8_t> GlCanvas::reduced(int step, int first, int rows) const {
    osmesa().glFinish();
    const int width = width_ / step;
    std::vector<std::uint8_t> rgb;
    rgb.reserve(std::size_t{3} * static_cast<std::size_t>(width) * static_cast<std::size_t>(rows));
    for (int y = first; y < first + rows; ++y) {
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

TriangleBatch::TriangleBatch(const Material& material) : material_(material) {
    corners_.reserve(kBatchTriangles * 3 * kCorner);
    constexpr float kLine = 0.3F;
    for (std::size_t i = 0; i < 3; ++i) {
        line_.at(i) = kLine * static_cast<float>(material.color.at(i)) / 255;
    }
}

void TriangleBatch::start() const {
    const OsMesa& gl = osmesa();
    // The back, where values are larger, is warmer and paler than the front.
    std::array<float, 4> front{0, 0, 0, 1};
    std::array<float, 4> back{0.85F, 0.72F, 0.60F, 1};
    for (std::size_t i = 0; i < 3; ++i) {
        front.at(i) = static_cast<float>(material_.color.at(i)) / 255;
        back.at(i) = 0.75F * back.at(i) + 0.25F * front.at(i);
    }
    gl.glMaterialfv(GL_FRONT, GL_AMBIENT_AND_DIFFUSE, front.data());
    gl.glMaterialfv(GL_BACK, GL_AMBIENT_AND_DIFFUSE, back.data());
    if (material_.of_vertices) {
        gl.glColorMaterial(GL_FRONT_AND_BACK, GL_AMBIENT_AND_DIFFUSE);
        gl.glEnable(GL_COLOR_MATERIAL);
    }
}

void TriangleBatch::add(const Double3& position, const Double3& normal,
                        const std::array<float, 3>& color) {
    for (const Double3& v : {position, normal}) {
        for (const double c : v) {
            corners_.push_back(static_cast<float>(c));
        }
    }
    corners_.insert(corners_.end(), color.begin(), color.end());
}

bool TriangleBatch::full() const {
    return corners_.size() >= kBatchTriangles * 3 * kCorner;
}

void TriangleBatch::draw() {
    const OsMesa& gl = osmesa();
    const auto count = static_cast<GLsizei>(corners_.size() / kCorner);
    constexpr auto kStride = static_cast<GLsizei>(kCorner * sizeof(float));
    gl.glEnableClientState(GL_VERTEX_ARRAY);
    gl.glEnableClientState(GL_NORMAL_ARRAY);
    gl.glVertexPointer(3, GL_FLOAT, kStride, corners_.data());
    gl.glNormalPointer(GL_FLOAT, kStride, corners_.data() + 3);
    if (material_.of_vertices) {
        gl.glEnableClientState(GL_COLOR_ARRAY);
        gl.glColorPointer(3, GL_FLOAT, kStride, corners_.data() + 6);
    }
    gl.glEnable(GL_LIGHTING);
    if (material_.wireframe) {
        gl.glEnable(GL_POLYGON_OFFSET_FILL);
        gl.glPolygonOffset(1, 1);
    }
    gl.glDrawArrays(GL_TRIANGLES, 0, count);
    if (material_.wireframe) {
        gl.glDisable(GL_POLYGON_OFFSET_FILL);
        gl.glDisable(GL_LIGHTING);
        gl.glDisableClientState(GL_COLOR_ARRAY);
        gl.glColor3fv(line_.data());
        gl.glLineWidth(1);
        gl.glPolygonMode(GL_FRONT_AND_BACK, GL_LINE);
        gl.glDrawArrays(GL_TRIANGLES, 0, count);
        gl.glPolygonMode(GL_FRONT_AND_BACK, GL_FILL);
    }
    corners_.clear();
}

}  // namespace isonest::detail::cli
