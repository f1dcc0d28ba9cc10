// How far a point is from several planes.
//
// Source: M. Garland, P. Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH
// 1997.
#pragma once

#include <algorithm>
#include <optional>

#include "query/simplify/proof/point_triangle.h"

namespace isonest::detail {

/// A weighted sum of squared distances from planes. Points are given relative to one origin.
class Quadric {
  public:
    /// The plane through `p` with unit normal `n`.
    void add_plane(const Double3& n, const Double3& p, double weight) {
        const double d = -dot(n, p);
        xx_ += weight * n[0] * n[0];
        yy_ += weight * n[1] * n[1];
        zz_ += weight * n[2] * n[2];
        xy_ += weight * n[0] * n[1];
        xz_ += weight * n[0] * n[2];
        yz_ += weight * n[1] * n[2];
        x_ += weight * n[0] * d;
        y_ += weight * n[1] * d;
        z_ += weight * n[2] * d;
        c_ += weight * d * d;
        weight_ += weight;
    }
    void add(const Quadric& other) {
        xx_ += other.xx_;
        yy_ += other.yy_;
        zz_ += other.zz_;
        xy_ += other.xy_;
        xz_ += other.xz_;
        yz_ += other.yz_;
        x_ += other.x_;
        y_ += other.y_;
        z_ += other.z_;
        c_ += other.c_;
        weight_ += other.weight_;
    }
    /// The mean squared distance.
    [[nodiscard]] double mean(const Double3& p) const {
        const double sum = p[0] * (xx_ * p[0] + 2 * (xy_ * p[1] + xz_ * p[2] + x_)) +
                           p[1] * (yy_ * p[1] + 2 * (yz_ * p[2] + y_)) +
                           p[2] * (zz_ * p[2] + 2 * z_) + c_;
        return weight_ > 0 ? std::max(sum, 0.0) / weight_ : 0;
    }
    /// Where the mean, plus a hundredth of the squared distance from `near`, is least: so along
    /// planes that are nearly the same it stays near. Nothing: there are no planes.
    [[nodiscard]] std::optional<Double3> lowest(const Double3& near) const {
        constexpr double kHold = 1e-2;
        const double hold = kHold * weight_;
        const double xx = xx_ + hold;
        const double yy = yy_ + hold;
        const double zz = zz_ + hold;
        const Double3 r{hold * near[0] - x_, hold * near[1] - y_, hold * near[2] - z_};
        // By Cramer's rule.
        const double of_xx = yy * zz - yz_ * yz_;
        const double of_xy = xz_ * yz_ - xy_ * zz;
        const double of_xz = xy_ * yz_ - xz_ * yy;
        const double of_yy = xx * zz - xz_ * xz_;
        const double of_yz = xy_ * xz_ - xx * yz_;
        const double of_zz = xx * yy - xy_ * xy_;
        const double determinant = xx * of_xx + xy_ * of_xy + xz_ * of_xz;
        if (!(determinant > 0)) {
            return std::nullopt;
        }
        return Double3{(of_xx * r[0] + of_xy * r[1] + of_xz * r[2]) / determinant,
                       (of_xy * r[0] + of_yy * r[1] + of_yz * r[2]) / determinant,
                       (of_xz * r[0] + of_yz * r[1] + of_zz * r[2]) / determinant};
    }

  private:
    double xx_ = 0, yy_ = 0, zz_ = 0, xy_ = 0, xz_ = 0, yz_ = 0, x_ = 0, y_ = 0, z_ = 0, c_ = 0;
    double weight_ = 0;
};

}  // namespace isonest::detail
