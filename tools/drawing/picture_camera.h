// From the world to the picture, without perspective.
#pragma once

#include <isonest/int3.h>

namespace isonest::detail::cli {

struct Bounds {
    Double3 lo{};
    Double3 hi{};
    /// Of nothing so far.
    void start();
    void add(const Double3& p);
};

/// World to picture: x to the right, y up, z toward the eye, the longest visible side 2.
class PictureCamera {
  public:
    /// `view`: from the mesh toward the eye; not zero.
    explicit PictureCamera(const Double3& view);
    /// In the world's units.
    [[nodiscard]] Double3 turn(const Double3& p) const;
    /// What is to be seen, turned.
    void fit(const Bounds& turned);
    [[nodiscard]] Double3 place(const Double3& p) const;
    [[nodiscard]] double half_extent(std::size_t axis) const { return half_.at(axis) * scale_; }
    /// Of a world unit in the picture's coordinates.
    [[nodiscard]] double scale() const { return scale_; }
    [[nodiscard]] const Double3& right() const { return right_; }
    [[nodiscard]] const Double3& up() const { return up_; }

  private:
    Double3 toward_eye_{};
    Double3 right_{};
    Double3 up_{};
    Double3 centre_{};
    Double3 half_{};
    double scale_ = 1;
};

}  // namespace isonest::detail::cli
