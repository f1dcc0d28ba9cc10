// Triangles drawn off screen by OSMesa, one part of a picture at a time.
#pragma once

#include <GL/gl.h>
#include <GL/osmesa.h>

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "tools/drawing/picture_frame.h"

namespace isonest::detail {

// Mesa's off-screen renderer, loaded on first use: it includes a compiler (LLVM) that takes longer
// to load than many extractions take.

// The functions that tools/drawing/picture.cpp calls.
#define ISONEST_OSMESA_FUNCTIONS(F) \
    F(OSMesaCreateContextAttribs)   \
    F(OSMesaDestroyContext)         \
    F(OSMesaMakeCurrent)            \
    F(OSMesaPixelStore)             \
    F(glClear)                      \
    F(glClearColor)                 \
    F(glColorMaterial)              \
    F(glColorPointer)               \
    F(glColor3fv)                   \
    F(glDepthFunc)                  \
    F(glDisable)                    \
    F(glDisableClientState)         \
    F(glDrawArrays)                 \
    F(glEnable)                     \
    F(glEnableClientState)          \
    F(glFinish)                     \
    F(glLightModelfv)               \
    F(glLightModeli)                \
    F(glLightfv)                    \
    F(glLineWidth)                  \
    F(glLoadIdentity)               \
    F(glMaterialfv)                 \
    F(glMatrixMode)                 \
    F(glNormalPointer)              \
    F(glOrtho)                      \
    F(glPolygonMode)                \
    F(glPolygonOffset)              \
    F(glReadPixels)                 \
    F(glVertexPointer)              \
    F(glViewport)

struct OsMesa {
// NOLINTNEXTLINE(bugprone-macro-parentheses): a name to declare
#define ISONEST_OSMESA_MEMBER(name) decltype(&::name) name = nullptr;
    ISONEST_OSMESA_FUNCTIONS(ISONEST_OSMESA_MEMBER)
#undef ISONEST_OSMESA_MEMBER
};

/// Throws Error{unsupported} if the library cannot be loaded. Thread-safe.
const OsMesa& osmesa();

}  // namespace isonest::detail

namespace isonest::detail::cli {

/// Half the size of the visible region, in camera coordinates.
struct Half {
    double x = 1;
    double y = 1;
    double middle_x = 0;  ///< of the picture
};
/// `right`: number of pixels to leave free on the right.
Half half_of(const PictureCamera& camera, int width, int height, double right);

/// An OpenGL context with its own pixel buffer, for some rows of the picture. Thread-safety: one
/// thread.
class GlCanvas {
  public:
    /// Throws Error{limit, unsupported}.
    GlCanvas(int width, int height);
    /// Prepares to draw the rows from `row` (which may be negative) of a picture of this width with
    /// `all` rows, and clears them to the background.
    void show(int row, int all, const Half& half) const;
    /// Darkens hollows, with a radius of `radius` pixels. Throws Error{limit} if the system cannot
    /// start the threads.
    void darken_hollows(double radius, const Half& half, int threads);
    /// Averages squares of `step` pixels; 8-bit RGB, `rows` rows of squares from `first`.
    [[nodiscard]] std::vector<std::uint8_t> reduced(int step, int first, int rows) const;
    /// Heap bytes per pixel: measured by tools/bench/peak_heap.cpp, rounded up.
    static constexpr std::uint64_t kHeapPerPixel = 21;

  private:
    struct Destroy {
        void operator()(OSMesaContext c) const { osmesa().OSMesaDestroyContext(c); }
    };
    int width_;
    int height_;
    std::vector<std::uint8_t> pixels_;
    std::vector<float> depth_;
    std::unique_ptr<std::remove_pointer_t<OSMesaContext>, Destroy> context_;
};

/// The appearance of the triangles.
struct Material {
    std::array<int, 3> color{};  ///< front side, 0 to 255
    bool of_vertices = false;    ///< corners have their own colours
    bool wireframe = false;
};

/// Collects triangles and draws many at a time.
class TriangleBatch {
  public:
    explicit TriangleBatch(const Material& material);
    /// Call this before the first triangle of each part of the picture.
    void start() const;
    void add(const Double3& position, const Double3& normal, const std::array<float, 3>& color);
    [[nodiscard]] bool full() const;
    void draw();

  private:
    Material material_;
    std::array<float, 3> line_{};
    std::vector<float> corners_;
};

}  // namespace isonest::detail::cli
