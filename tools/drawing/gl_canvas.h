// Triangles drawn off screen by OSMesa, a part of a picture at a time.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "tools/drawing/osmesa.h"
#include "tools/drawing/picture_camera.h"

namespace isonest::detail::cli {

/// Half of what is seen, in the camera's coordinates.
struct Half {
    double x = 1;
    double y = 1;
    double middle_x = 0;  ///< of the picture
};
/// `right`: pixels on the right that are left free.
Half half_of(const PictureCamera& camera, int width, int height, double right);

/// An OpenGL context that draws into its own pixels: some rows of the picture. Thread-safety: one
/// thread.
class GlCanvas {
  public:
    /// Throws Error{limit, unsupported}.
    GlCanvas(int width, int height);
    /// What is drawn next is the rows from `row` on (before the first one, too) of a picture of
    /// this width and `all` rows; the background is drawn.
    void show(int row, int all, const Half& half) const;
    /// Multiplies what lies in hollows, looking `radius` pixels far. Throws Error{limit} if the
    /// system refuses the threads.
    void darken_hollows(double radius, const Half& half, int threads);
    /// Averages squares of `step` pixels; 8-bit RGB, `rows` rows of them from `first` on.
    [[nodiscard]] std::vector<std::uint8_t> reduced(int step, int first, int rows) const;
    /// Heap for each pixel: measured by tools/bench/peak_heap.cpp, rounded up.
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

/// What the triangles look like.
struct Material {
    std::array<int, 3> color{};  ///< of the front, 0 to 255
    bool of_vertices = false;    ///< corners have colours of their own
    bool wireframe = false;
};

/// Collects triangles and draws them when there are many.
class TriangleBatch {
  public:
    explicit TriangleBatch(const Material& material);
    /// Before the first one of each part of the picture.
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
