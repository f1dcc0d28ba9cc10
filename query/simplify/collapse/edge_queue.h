// The order in which edges of a corner mesh are collapsed: the one that changes the surface least
// comes first.
//
// Source: M. Garland, P. Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH
// 1997. The quadric estimates determine only the order; they are not a guarantee.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "query/simplify/collapse/corner_mesh.h"
#include "query/simplify/proof/point_triangle.h"

namespace isonest::detail {

// The distance of a point from several planes.
//
// Source: M. Garland, P. Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH
// 1997.

/// A weighted sum of squared distances from planes. Points are relative to a common origin.
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
    /// The minimum of the mean plus a hundredth of the squared distance from `near`; the second
    /// term keeps it near where planes are almost the same. Nothing: there are no planes.
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

/// Squared errors of edges (world units), in bins of a sixteenth of a power of two.
inline std::size_t bin_of(float square_error) {
    constexpr float kMin = 1e-30F;
    return std::bit_cast<std::uint32_t>(square_error + kMin) >> 19U;
}
/// The largest error in the bin.
inline float end_of_bin(std::size_t bin) {
    return std::bit_cast<float>(static_cast<std::uint32_t>((bin + 1) << 19U) - 1);
}

/// Not thread-safe.
class EdgeQueue {
  public:
    struct Edge {
        float square_error;  ///< world units
        std::uint32_t from;
        std::uint32_t to;
        std::uint32_t state;

        /// Version of the quadric of `from`.
        [[nodiscard]] std::uint32_t version() const { return state / 2; }
        /// Edges from `from` with larger errors are not in the queue yet.
        [[nodiscard]] bool has_others() const { return state % 2 != 0; }
    };

    /// Edges with an error larger than `most` (world units, squared) are never returned. The
    /// arguments must outlive the queue; positions of vertices into which edges were collapsed may
    /// change.
    EdgeQueue(std::span<const std::array<float, 3>> positions, const CornerMesh& mesh, float most);

    /// Call before the first add(): edges from vertex v with an error larger than max_of[v] are
    /// never returned either.
    void limit(std::vector<float> max_of) { max_of_ = std::move(max_of); }
    /// Adds the edges from `v` to the queue.
    void add(std::uint32_t v);
    /// An edge with the smallest error, up to a sixteenth of its power of two. Nothing: the queue
    /// is empty.
    std::optional<Edge> next();
    /// Reports that the last returned edge is not collapsed. `ring`: around its start.
    void stays(const Edge& edge, const CornerMesh::Ring& ring);
    /// Returns the last returned edge to the queue, with this error.
    void defer(const Edge& edge, float square_error) {
        push({square_error, edge.from, edge.to, 2 * edge.version()});
    }
    /// Whether the edge in the opposite direction has a smaller error and comes first.
    [[nodiscard]] bool comes_later_than_back(const Edge& edge) const {
        return square_error(edge.to, edge.from) < edge.square_error;
    }
    /// Bin of the last returned edge.
    [[nodiscard]] std::size_t bin() const { return lowest_; }
    /// The position for both vertices that changes the surface least.
    [[nodiscard]] std::optional<Double3> lowest(std::uint32_t from, std::uint32_t to) const {
        Quadric both = quadrics_[from];
        both.add(quadrics_[to]);
        const std::optional<Double3> p = both.lowest(at(to));
        return p ? std::optional(
                       Double3{(*p)[0] + origin_[0], (*p)[1] + origin_[1], (*p)[2] + origin_[2]})
                 : std::nullopt;
    }
    /// Reports that `from` was collapsed into `to`, whose ring is `ring`. Edges there are added
    /// again, except those from locked vertices.
    void collapsed(std::uint32_t from, const CornerMesh::Ring& ring,
                   const std::vector<bool>& locked);

  private:
    /// Edges with nearly the same error, in the order in which they were added.
    struct Bin {
        std::uint32_t first = CornerMesh::kNone;
        std::uint32_t last = CornerMesh::kNone;
    };
    struct Waiting {
        Edge edge;
        std::uint32_t next;  ///< in its bin, or in the free list
    };
    [[nodiscard]] Double3 at(std::uint32_t v) const {
        const auto& p = positions_[v];
        return {static_cast<double>(p[0]) - origin_[0], static_cast<double>(p[1]) - origin_[1],
                static_cast<double>(p[2]) - origin_[2]};
    }
    void add_quadrics(std::uint32_t triangle);
    void push(const Edge& edge);
    [[nodiscard]] float max_from(std::uint32_t v) const {
        return max_of_.empty() ? max_ : std::min(max_, max_of_[v]);
    }
    void push_next(const CornerMesh::Ring& ring, float after, std::uint32_t after_to);
    [[nodiscard]] float square_error(std::uint32_t from, std::uint32_t to) const {
        return static_cast<float>(quadrics_[from].mean(at(to)));
    }

    std::span<const std::array<float, 3>> positions_;
    const CornerMesh& mesh_;
    float max_;                  ///< maximum squared error
    std::vector<float> max_of_;  ///< for edges from each vertex; empty: no further limits
    Double3 origin_{};
    std::vector<Quadric> quadrics_;
    std::vector<std::uint32_t> version_;
    std::vector<Waiting> waiting_;
    std::uint32_t free_ = CornerMesh::kNone;  ///< in waiting_
    std::vector<Bin> bins_;
    std::size_t lowest_ = 0;  ///< no bin before it has an edge
    CornerMesh::Ring ring_;
};

}  // namespace isonest::detail
