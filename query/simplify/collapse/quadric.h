// How far a point is from several planes.
//
// Source: M. Garland, P. Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH
// 1997.
#pragma once

#include <algorithm>

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

  private:
    double xx_ = 0, yy_ = 0, zz_ = 0, xy_ = 0, xz_ = 0, yz_ = 0, x_ = 0, y_ = 0, z_ = 0, c_ = 0;
    double weight_ = 0;
};

}  // namespace isonest::detail
