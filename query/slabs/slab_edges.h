// Which vertices lie on the edges of the lattice around a row of cells.
//
// Source: numbers of the vertices are kept for the edges of two planes of nodes and two rows
// between them, as in W. Schroeder, R. Maynard, B. Geveci, "Flying Edges: a high-performance
// scalable isocontouring algorithm", LDAV 2015, by rows: nothing is hashed.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include <isonest/int3.h>

#include "query/march/cube_cases.h"
#include "query/view/topology.h"

namespace isonest::detail {

/// Rows of edges are cleared when cells beside them are looked at for the first time: a surface
/// that passes through few rows costs little. Edges are numbered as kCubeEdge numbers those of a
/// cell. Not thread-safe.
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

    /// No edge has a vertex any more.
    void forget() { stamp_ += static_cast<std::uint64_t>(nodes_.z) + 1; }
    /// From now on, cells between planes z and z + 1. In ascending order, without gaps, except
    /// after forget().
    void begin_layer(std::int64_t z) {
        z_ = z;
        std::swap(planes_[0], planes_[1]);
    }
    /// Of this layer, cells between rows y and y + 1. In ascending order; rows may be left out.
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

    /// Calls f(edge, vertex) for edges in the plane below (0) or above (1) that have a vertex:
    /// twice the low node's number in the plane, one more along y; ascending.
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
    /// Calls f(low node, axis, vertex) for edges with a vertex that cells after row y touch as
    /// well, in this layer or the next.
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
    /// Edges in a plane, by their low node; what a row without the plane's stamp says is void.
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

    /// Of the plane below (0) or above (1) the cells.
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
    std::uint64_t stamp_ = 1;  ///< of plane 0; grows, so that none comes again
    std::array<Plane, 2> planes_;
    std::array<Between, 2> between_;                  ///< even and odd rows
    std::array<std::uint32_t*, kCubeEdges> slots_{};  ///< of cell 0 of the row
};

}  // namespace isonest::detail
