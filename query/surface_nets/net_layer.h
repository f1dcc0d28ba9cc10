// The vertices of a surface net in one layer of cells, and how they are moved.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <isonest/int3.h>

#include "query/surface_nets/net_cell.h"

namespace isonest::detail {

/// How far along an axis a vertex may go from the centre of its cell, in distances of neighbouring
/// nodes: a cell reaches to 1/2. The rest, 1/32, is for the rounding of coordinates to float32.
inline constexpr float kMostMoved = 0.5F - 1.0F / 32;
/// The same towards a node that is slim: so what is one node thick keeps at least half of it.
inline constexpr float kMostMovedToSlim = 0.25F;

/// Of a plane of nodes, the axes (bits x, y, z) along which each is slim: it has a label which
/// neither neighbour along the axis has, and the same holds along another axis. So rods and single
/// nodes are slim, and sheets are not, which would become steps. `before` and `after`: the planes
/// below and above. Nodes at the edge of what is given are not slim.
void find_slim(std::span<const std::int64_t> before, std::span<const std::int64_t> plane,
               std::span<const std::int64_t> after, const Int3& nodes,
               std::vector<std::uint8_t>& slim);

/// A plane of nodes: their labels, and which are slim.
struct NetPlane {
    std::span<const std::int64_t> label;
    std::span<const std::uint8_t> slim;
};

/// Cells that labels cross, row by row, each with a vertex. Cells are counted from the low corner
/// of the part of the volume that is worked on.
class NetLayer {
  public:
    /// From the planes of nodes on both sides: cell (x, y) has the nodes x, x + 1 and y, y + 1 of
    /// `size` in each. The vertices are in the centres. `held`: bit 2 axis for the first cell
    /// along an axis, 2 axis + 1 for the last, if the volume's border passes through its centre;
    /// along that axis vertices stay there (of z both bits say the same: this layer's vertices).
    void begin(const NetPlane& below, const NetPlane& above, const Int3& nodes, unsigned held);
    /// Moves each vertex by `weight` of the way to the mean of its neighbours, and holds it in its
    /// cell. `below` and `above`: the layers there, or null; of `below`, which was moved before,
    /// the places that it had before count. A neighbour that is not there does not count.
    void move(const NetLayer* below, const NetLayer* above, float weight);

    [[nodiscard]] std::size_t size() const { return x_.size(); }
    [[nodiscard]] std::int64_t row_count() const {
        return static_cast<std::int64_t>(rows_.size()) - 1;
    }
    /// The first vertex of a row of cells; that of row_count() is size().
    [[nodiscard]] std::uint32_t row(std::int64_t y) const {
        return rows_[static_cast<std::size_t>(y)];
    }
    [[nodiscard]] std::int64_t x(std::uint32_t vertex) const { return x_[vertex]; }
    /// From the cell's centre, in distances of neighbouring nodes.
    [[nodiscard]] const std::array<float, 3>& moved(std::uint32_t vertex) const {
        return at_[vertex];
    }
    /// Numbers that whoever takes the vertices gives them.
    [[nodiscard]] std::span<std::uint32_t> numbers() { return number_; }
    [[nodiscard]] std::uint32_t number(std::uint32_t vertex) const { return number_[vertex]; }

    /// Bytes of heap for each cell, at most.
    static constexpr std::uint64_t kBytesPerCell = 2 + 1 + 1 + 1 + 2 * 12 + 4;

  private:
    std::vector<std::uint32_t> rows_;
    std::vector<std::uint16_t> x_;
    std::vector<std::uint8_t> neighbours_;  ///< as neighbours_of() says
    std::vector<std::uint8_t> held_;        ///< bit for each axis
    std::vector<std::uint8_t> slim_;        ///< bit 2 axis + side: a node there is slim along it
    std::vector<std::array<float, 3>> at_;
    std::vector<std::array<float, 3>> before_;  ///< the last move
    std::vector<std::uint32_t> number_;
};

/// Finds vertices of a row of cells, from left to right.
class NetRowCursor {
  public:
    /// `layer` may be null, and `y` outside: then nothing is found.
    NetRowCursor(const NetLayer* layer, std::int64_t y)
        : layer_(layer),
          at_(has(layer, y) ? layer->row(y) : 0),
          end_(has(layer, y) ? layer->row(y + 1) : 0) {}
    static constexpr std::uint32_t kNone = 0xFFFFFFFF;
    /// The vertex of cell x, or kNone. REQUIRES: x is not less than in the last call.
    std::uint32_t find(std::int64_t x) {
        while (at_ < end_ && layer_->x(at_) < x) {
            ++at_;
        }
        return at_ < end_ && layer_->x(at_) == x ? at_ : kNone;
    }

  private:
    static bool has(const NetLayer* layer, std::int64_t y) {
        return layer != nullptr && y >= 0 && y < layer->row_count();
    }
    const NetLayer* layer_;
    std::uint32_t at_;
    std::uint32_t end_;
};

}  // namespace isonest::detail
