// The vertices on the edges of the lattice around a row of cells.
//
// Source: numbers of the vertices are stored for the edges of two planes of nodes and two rows
// between them, as in W. Schroeder, R. Maynard, B. Geveci, "Flying Edges: a high-performance
// scalable isocontouring algorithm", LDAV 2015, by rows: no hashing is needed.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include <isonest/int3.h>

#include "query/march/cube_cases.h"
#include "query/slabs/slab_reader.h"
#include "query/values/topology.h"
#include "store/base/vectors.h"

namespace isonest::detail {

/// Rows of edges are cleared when cells beside them are first visited, so a surface that passes
/// through few rows costs little. Edges are numbered like those of a cell in kCubeEdge. Not
/// thread-safe.
class SlabEdges {
  public:
    static constexpr std::uint32_t kNone = 0xFFFFFFFFU;

    explicit SlabEdges(const Int3& nodes) : nodes_(nodes) {
        const auto rows = static_cast<std::size_t>(nodes.y);
        const auto size = static_cast<std::size_t>(nodes.x) * rows;
        for (Plane& plane : planes_) {
            plane.along_x = std::make_unique_for_overwrite<std::uint32_t[]>(size);
            plane.along_y = std::make_unique_for_overwrite<std::uint32_t[]>(size);
            plane.x_of.assign(rows, 0);
            plane.y_of.assign(rows, 0);
        }
        for (Between& row : between_) {
            row.edges =
                std::make_unique_for_overwrite<std::uint32_t[]>(static_cast<std::size_t>(nodes.x));
        }
    }
    /// Bytes of heap.
    static std::uint64_t bytes(const Int3& nodes) {
        return (static_cast<std::uint64_t>(4 * nodes.y + 2) * sizeof(std::uint32_t)) *
                   static_cast<std::uint64_t>(nodes.x) +
               static_cast<std::uint64_t>(4 * nodes.y) * sizeof(std::uint64_t);
    }

    /// Removes the vertices from all edges.
    void forget() { stamp_ += static_cast<std::uint64_t>(nodes_.z) + 1; }
    /// Starts the cells between planes z and z + 1. In ascending order, without gaps, except after
    /// forget().
    void begin_layer(std::int64_t z) {
        z_ = z;
        std::swap(planes_[0], planes_[1]);
    }
    /// Starts the cells of this layer between rows y and y + 1. In ascending order; rows may be
    /// skipped.
    void begin_row(std::int64_t y) {
        clear_around(y);
        for (std::size_t e = 0; e < kCubeEdges; ++e) {
            const Int3 low = corner_offset(kCubeEdge[e].low);
            const Plane& plane = planes_[static_cast<std::size_t>(low.z)];
            switch (kCubeEdge[e].low ^ kCubeEdge[e].high) {
                case 1:
                    slots_[e] = plane.along_x.get() + (y + low.y) * nodes_.x;
                    break;
                case 2:
                    slots_[e] = plane.along_y.get() + y * nodes_.x + low.x;
                    break;
                case 4:
                    slots_[e] = between_of(y + low.y).edges.get() + low.x;
                    break;
                default:
                    slots_[e] = nullptr;  // a diagonal
            }
        }
    }
    /// The vertex on an edge of cell x of the row, or kNone.
    [[nodiscard]] std::uint32_t& at(std::int64_t x, std::size_t edge) { return slots_[edge][x]; }

    /// Calls f(edge, vertex) for edges with a vertex in the plane below (0) or above (1). An edge's
    /// number is twice the number of its low node in the plane, plus one along y; ascending.
    template <class F>
    void for_plane(std::size_t side, const F& f) const {
        const Plane& plane = planes_[side];
        const auto nx = static_cast<std::size_t>(nodes_.x);
        for (std::size_t row = 0; row < plane.x_of.size(); ++row) {
            const bool has_x = plane.x_of[row] == stamp_of(side);
            const bool has_y = plane.y_of[row] == stamp_of(side);
            for (std::size_t i = row * nx; (has_x || has_y) && i < (row + 1) * nx; ++i) {
                if (has_x && plane.along_x[i] != kNone) {
                    f(2 * i, plane.along_x[i]);
                }
                if (has_y && plane.along_y[i] != kNone) {
                    f(2 * i + 1, plane.along_y[i]);
                }
            }
        }
    }
    /// Calls f(low node, axis, vertex) for edges with a vertex that also belong to cells after row
    /// y, in this layer or the next.
    template <class F>
    void for_later(std::int64_t y, const F& f) const {
        const auto row_of = [&](const std::uint32_t* edges, const Int3& low, int axis) {
            for (std::int64_t x = 0; x < nodes_.x; ++x) {
                if (edges[x] != kNone) {
                    f(Int3{x, low.y, low.z}, axis, edges[x]);
                }
            }
        };
        const bool has_next_row = y + 2 < nodes_.y;
        const bool has_next_layer = z_ + 2 < nodes_.z;
        for (std::size_t side = 0; side < 2; ++side) {
            const Plane& plane = planes_[side];
            const std::int64_t z = z_ + static_cast<std::int64_t>(side);
            const bool all = side == 1 && has_next_layer;
            for (std::int64_t row = all ? 0 : y + 1; (all || has_next_row) && row < nodes_.y;
                 ++row) {
                if (plane.x_of[static_cast<std::size_t>(row)] == stamp_of(side)) {
                    row_of(plane.along_x.get() + row * nodes_.x, {0, row, z}, 0);
                }
                if (plane.y_of[static_cast<std::size_t>(row)] == stamp_of(side)) {
                    row_of(plane.along_y.get() + row * nodes_.x, {0, row, z}, 1);
                }
            }
        }
        const Between& next = between_[static_cast<std::size_t>((y + 1) & 1)];
        if (has_next_row && next.row == y + 1 && next.of == stamp_of(0)) {
            row_of(next.edges.get(), {0, y + 1, z_}, 2);
        }
    }

  private:
    /// Edges in a plane, by their low node; a row without the plane's stamp is invalid.
    struct Plane {
        std::unique_ptr<std::uint32_t[]> along_x;
        std::unique_ptr<std::uint32_t[]> along_y;
        std::vector<std::uint64_t> x_of;  ///< stamps
        std::vector<std::uint64_t> y_of;
    };
    /// A row of edges along z, by their low node.
    struct Between {
        std::unique_ptr<std::uint32_t[]> edges;
        std::int64_t row = 0;
        std::uint64_t of = 0;  ///< stamp of the plane below
    };

    /// For the plane below (0) or above (1) the cells.
    [[nodiscard]] std::uint64_t stamp_of(std::size_t side) const {
        return stamp_ + static_cast<std::uint64_t>(z_) + side;
    }
    Between& between_of(std::int64_t row) { return between_[static_cast<std::size_t>(row & 1)]; }
    void clear_unless(std::uint64_t& of, std::uint64_t stamp, std::uint32_t* row) const {
        if (of != stamp) {
            of = stamp;
            std::fill_n(row, nodes_.x, kNone);
        }
    }
    void clear_around(std::int64_t y) {
        for (std::size_t side = 0; side < 2; ++side) {
            Plane& plane = planes_[side];
            for (const std::int64_t row : {y, y + 1}) {
                clear_unless(plane.x_of[static_cast<std::size_t>(row)], stamp_of(side),
                             plane.along_x.get() + row * nodes_.x);
            }
            clear_unless(plane.y_of[static_cast<std::size_t>(y)], stamp_of(side),
                         plane.along_y.get() + y * nodes_.x);
        }
        for (const std::int64_t row : {y, y + 1}) {
            Between& between = between_of(row);
            if (between.row != row) {
                between.row = row;
                between.of = 0;
            }
            clear_unless(between.of, stamp_of(0), between.edges.get());
        }
    }

    Int3 nodes_;
    std::int64_t z_ = 0;
    std::uint64_t stamp_ = 1;  ///< of plane 0; increases, so stamps do not repeat
    std::array<Plane, 2> planes_;
    std::array<Between, 2> between_;                  ///< even and odd rows
    std::array<std::uint32_t*, kCubeEdges> slots_{};  ///< for cell 0 of the row
};

// Normals of vertices on edges of the lattice, computed for many vertices at a time.

/// Vertices whose normals are still to be computed. The values around them are in several rows, far
/// apart in memory: in one loop the processor waits for those of many vertices at once, and divides
/// two numbers at a time. The results are identical to those of unit_normal(). Not thread-safe.
template <class T>
class EdgeNormals {
  public:
    /// A vertex at fraction t of the edge from a node along an axis.
    struct Vertex {
        const T* at;  ///< the node's value
        double t;
        std::uint32_t axis;
        std::uint32_t number;
    };

    explicit EdgeNormals(const SlabGradient<T>& gradient) : gradient_(gradient) {}

    /// REQUIRES: not is_full(); the edge is an inner one (SlabGradient).
    void add(const Vertex& vertex) { vertices_[count_++] = vertex; }
    [[nodiscard]] bool is_full() const { return count_ == kAtOnce; }
    void clear() { count_ = 0; }
    /// Writes the normals of all waiting vertices, by number.
    void compute(std::vector<std::array<float, 3>>& normals) {
        if (count_ == 0) {
            return;
        }
        for (std::size_t k = 0; k < count_; ++k) {
            gradient_.differences(vertices_[k].at, vertices_[k].axis, k, from_, to_);
            part_[k] = vertices_[k].t;
        }
        // Always processes all rows, so that the compiler knows the number; those behind the last
        // are unused.
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double step = gradient_.step(axis);
            for (std::size_t k = 0; k < kAtOnce; ++k) {
                const double from = from_[axis][k] / step;
                const double to = to_[axis][k] / step;
                normal_[axis][k] = -(from + part_[k] * (to - from));
            }
        }
        for (std::size_t k = 0; k < kAtOnce; ++k) {
            const double x = std::fabs(normal_[0][k]);
            const double y = std::fabs(normal_[1][k]);
            const double z = std::fabs(normal_[2][k]);
            const double xy = x < y ? y : x;
            const double most = xy < z ? z : xy;
            largest_[k] = most;
            square_[k] =
                (x / most) * (x / most) + (y / most) * (y / most) + (z / most) * (z / most);
        }
        for (std::size_t k = 0; k < kAtOnce; ++k) {
            size_[k] = largest_[k] * std::sqrt(square_[k]);
        }
        for (std::size_t axis = 0; axis < 3; ++axis) {
            for (std::size_t k = 0; k < kAtOnce; ++k) {
                unit_[axis][k] = normal_[axis][k] / size_[k];
            }
        }
        for (std::size_t k = 0; k < count_; ++k) {
            // The others are 0, NaN, or so large or small that squares leave the range.
            const bool is_common = size_[k] >= 0x1p-500 && size_[k] <= 0x1p+500;
            normals[vertices_[k].number] =
                is_common ? std::array<float, 3>{static_cast<float>(unit_[0][k]),
                                                 static_cast<float>(unit_[1][k]),
                                                 static_cast<float>(unit_[2][k])}
                          : unit_normal({normal_[0][k], normal_[1][k], normal_[2][k]});
        }
        count_ = 0;
    }

  private:
    static constexpr std::size_t kAtOnce = 64;
    using Row = std::array<double, kAtOnce>;

    const SlabGradient<T>& gradient_;
    std::array<Vertex, kAtOnce> vertices_{};
    std::size_t count_ = 0;
    std::array<Row, 3> from_{};  ///< differences at the edge's ends
    std::array<Row, 3> to_{};
    Row part_{};
    std::array<Row, 3> normal_{};
    Row largest_{};
    Row square_{};
    Row size_{};
    std::array<Row, 3> unit_{};
};

}  // namespace isonest::detail
