// The surface net of all labels in a block of cells: layer by layer; each is moved as soon as the
// adjacent layers are available.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include <isonest/int3.h>

#include "query/surface_nets/net_store.h"
#include "store/base/vectors.h"
#include "store/container/chunk_cache.h"

namespace isonest::detail {

// One cell of a surface net: the neighbours to which its vertex is connected.
//
// Source: S. F. F. Gibson, "Constrained elastic surface nets: generating smooth surfaces from
// binary segmented data", MICCAI 1998.

/// Used instead of a label at nodes outside the volume, and at nodes with a missing value.
inline constexpr std::int64_t kOutsideLabel = std::numeric_limits<std::int64_t>::min();
inline constexpr std::int64_t kMissingLabel = kOutsideLabel + 1;

/// Whether this is a label of nodes.
inline bool has_mesh(std::int64_t label) {
    return label != kOutsideLabel && label != kMissingLabel;
}

/// Labels at the corners of a cell; corner x + 2 y + 4 z.
using CellLabels = std::array<std::int64_t, 8>;

/// The neighbouring cells (across the face with bit 2 axis + (0 low, 1 high)) whose vertices are
/// averaged for this cell's vertex: those connected by a mesh edge, that is, across faces whose
/// corners have different labels. On lines where more than two sheets meet (faces with more than
/// two sides that cross labels), only those along the line, if the line continues in two of them:
/// so the line is smoothed as a line, and no sheet pulls it to its side.
inline std::uint8_t neighbours_of(const CellLabels& label) {
    unsigned all = 0;
    unsigned lines = 0;
    for (unsigned axis = 0; axis < 3; ++axis) {
        const unsigned u = 1U << ((axis + 1) % 3);
        const unsigned v = 1U << ((axis + 2) % 3);
        for (unsigned side = 0; side < 2; ++side) {
            const unsigned first = side << axis;
            const unsigned crossed = (label[first] != label[first | u] ? 1U : 0U) +
                                     (label[first] != label[first | v] ? 1U : 0U) +
                                     (label[first | u] != label[first | u | v] ? 1U : 0U) +
                                     (label[first | v] != label[first | u | v] ? 1U : 0U);
            const unsigned bit = 1U << (2 * axis + side);
            all |= crossed > 0 ? bit : 0;
            lines |= crossed > 2 ? bit : 0;
        }
    }
    return static_cast<std::uint8_t>(std::popcount(lines) > 1 ? lines : all);
}

// The labels of the nodes in a part of a plane of a store.

/// Holds the chunks of the last plane, so planes in ascending order decode no chunk twice.
/// Thread-safety: none; one for each thread, with a common cache.
class LabelPlanes {
  public:
    /// `name`: of the store. The arguments must outlive it.
    LabelPlanes(ChunkCache& cache, const std::string& name)
        : cache_(cache),
          array_(cache.source().layout().array(0, Field::values)),
          bits_(cache.source().layout().header().labels),
          name_(name) {}

    /// Fills `to`, x fastest, with the labels of size.x * size.y nodes starting at `low` in the
    /// plane low.z; nodes outside the volume get kOutsideLabel, missing ones kMissingLabel. Throws
    /// Error{unsupported} for values that are not labels, and what the cache throws. REQUIRES:
    /// between two calls of begin() low.x, low.y and size are the same.
    void read(const Int3& low, const Int3& size, std::span<std::int64_t> to);
    /// Call before another part of the volume.
    void begin() { held_.clear(); }
    /// Maximum size of the chunks held for parts of this size, bytes.
    [[nodiscard]] static std::uint64_t held_bytes(const ArrayInfo& array, std::int64_t edge);

  private:
    struct Held {
        Int3 chunk;
        DecodedChunk data;  ///< null if all nodes have `all`
        std::int64_t all = 0;
    };
    void hold(const Int3& first, const Int3& last);
    void copy(const Held& held, const Int3& low, const Int3& size,
              std::span<std::int64_t> to) const;

    ChunkCache& cache_;
    const ArrayInfo& array_;
    bool bits_;
    const std::string& name_;
    std::vector<Held> held_;
};

// The vertices of a surface net in one layer of cells, and their movement.

/// Maximum movement of a vertex along an axis from the centre of its cell, as a multiple of the
/// distance between neighbouring nodes: the cell ends at 1/2. The difference of 1/32 allows for the
/// rounding of coordinates to float32.
inline constexpr float kMaxMoved = 0.5F - 1.0F / 32;
/// The same towards a slim node: structures one node thick keep at least half of their thickness.
inline constexpr float kMaxMovedToSlim = 0.25F;

/// For each node of a plane, the axes (bits x, y, z) along which it is slim: neither neighbour
/// along the axis has its label, and the same holds along another axis. So rods and single nodes
/// are slim, but not sheets, which would become stepped. `before` and `after`: the planes below and
/// above. Nodes at the edge of the given part are not slim.
void find_slim(std::span<const std::int64_t> before, std::span<const std::int64_t> plane,
               std::span<const std::int64_t> after, const Int3& nodes,
               std::vector<std::uint8_t>& slim);

/// A plane of nodes, with their labels and slim axes.
struct NetPlane {
    std::span<const std::int64_t> label;
    std::span<const std::uint8_t> slim;
};

/// Cells crossed by label borders, row by row, each with a vertex. Cells are counted from the low
/// corner of the processed part of the volume.
class NetLayer {
  public:
    /// Creates the layer from the planes of nodes on both sides: cell (x, y) has the nodes x, x + 1
    /// and y, y + 1 of `size` in each. Vertices are placed at the centres. `held`: bit 2 axis for
    /// the first cell along an axis, 2 axis + 1 for the last, if the volume's border passes through
    /// its centre; vertices are then not moved along that axis (for z, both bits have the same
    /// meaning: the vertices of this layer).
    void begin(const NetPlane& below, const NetPlane& above, const Int3& nodes, unsigned held);
    /// Moves each vertex by `weight` of the way to the mean of its neighbours, and limits it to its
    /// cell. `below` and `above`: the adjacent layers, or null; for `below`, which was already
    /// moved, the previous positions are used. Missing neighbours are ignored.
    void move(const NetLayer* below, const NetLayer* above, float weight);

    [[nodiscard]] std::size_t size() const { return x_.size(); }
    [[nodiscard]] std::int64_t row_count() const {
        return static_cast<std::int64_t>(rows_.size()) - 1;
    }
    /// The first vertex of a row of cells; row(row_count()) is size().
    [[nodiscard]] std::uint32_t row(std::int64_t y) const {
        return rows_[static_cast<std::size_t>(y)];
    }
    [[nodiscard]] std::int64_t x(std::uint32_t vertex) const { return x_[vertex]; }
    /// Offset from the cell's centre, as a multiple of the distance between neighbouring nodes.
    [[nodiscard]] const std::array<float, 3>& moved(std::uint32_t vertex) const {
        return at_[vertex];
    }
    /// Numbers assigned to the vertices by their user.
    [[nodiscard]] std::span<std::uint32_t> numbers() { return number_; }
    [[nodiscard]] std::uint32_t number(std::uint32_t vertex) const { return number_[vertex]; }

    /// Maximum heap per cell, bytes.
    static constexpr std::uint64_t kBytesPerCell = 2 + 1 + 1 + 1 + 2 * 12 + 4;

  private:
    std::vector<std::uint32_t> rows_;
    std::vector<std::uint16_t> x_;
    std::vector<std::uint8_t> neighbours_;  ///< see neighbours_of()
    std::vector<std::uint8_t> held_;        ///< bit for each axis
    std::vector<std::uint8_t> slim_;  ///< bit 2 axis + side: a node there is slim along the axis
    std::vector<std::array<float, 3>> at_;
    std::vector<std::array<float, 3>> before_;  ///< before the last move
    std::vector<std::uint32_t> number_;
};

/// Finds vertices of a row of cells, from left to right.
class NetRowCursor {
  public:
    /// If `layer` is null or `y` is outside, nothing is found.
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

/// Cell c of an axis with n nodes is between the nodes c - 1 and c; the volume's border, half a
/// node spacing beyond the last nodes, passes through cells 0 and n.
struct NetSetting {
    Int3 nodes{};
    LatticeSteps steps = {};
    Double3 origin{};
    int passes = 0;       ///< number of smoothing passes
    bool closed = false;  ///< whether labels are closed at the volume's border
    std::span<const std::int64_t> wanted = {};  ///< labels that get a mesh, ascending
    /// Record the labels on both sides of quads, and include unlabelled space in the shared areas.
    bool sides = false;

    [[nodiscard]] Int3 cells() const { return nodes + Int3{1, 1, 1}; }
    /// Number of cells around a block that its vertices depend on or its quads need.
    [[nodiscard]] std::int64_t halo() const { return passes + 1; }
};

/// The weight of pass number `pass` of `passes`: the fraction of the way to the mean of the
/// neighbours. Three of four passes have weight 0.6, and the fourth goes as far back as those three
/// went, so that large structures keep their size and only small ones are smoothed away; the last
/// three passes always go forward. Source: G. Taubin, "A signal processing approach to fair surface
/// design", SIGGRAPH 1995, with the weights of his two steps in equal sums.
float weight_of_pass(int pass, int passes);

/// Thread-safety: none; one for each thread, reused.
class NetBlock {
  public:
    /// `store`: its name. The arguments must outlive it.
    NetBlock(const NetSetting& setting, ChunkCache& cache, const std::string& store)
        : setting_(setting), planes_(cache, store) {}

    /// Passes the pieces in the cells [lo, hi) to `done`, one after another; pieces may be empty.
    /// REQUIRES: lo is a multiple of kPieceCells; so is hi, unless it is the end of the cells.
    /// Throws what LabelPlanes and `done` throw.
    void make(const Int3& lo, const Int3& hi, const std::function<void(const NetPiece&)>& done);

    /// Maximum heap for blocks with this edge, bytes.
    [[nodiscard]] static std::uint64_t heap(const NetSetting& setting, const ArrayInfo& array,
                                            std::int64_t edge);

  private:
    /// A cell around an edge, and its vertex.
    struct Corner {
        Int3 cell{};
        const NetLayer* layer = nullptr;
        std::uint32_t vertex = 0;
    };
    void begin(const Int3& lo, const Int3& hi);
    void read_layer(std::int64_t z);
    void move_layers(std::int64_t newest);
    void emit_layer(std::int64_t z);
    void emit_row(std::int64_t z, std::int64_t y);
    void emit_vertex(const Corner& corner, const CellLabels& label, NetPiece& piece);
    void emit_quads(const std::array<Corner, 8>& corner, const CellLabels& label, NetPiece& piece);
    [[nodiscard]] bool is_of(const CellLabels& label, std::size_t corner, bool at_border) const;
    [[nodiscard]] bool is_wanted(std::int64_t label);
    [[nodiscard]] std::array<float, 3> place_of(const Corner& corner) const;
    [[nodiscard]] NetLayer* layer(std::int64_t z);
    [[nodiscard]] std::span<std::int64_t> plane(std::int64_t z);
    [[nodiscard]] NetPiece& piece_at(std::int64_t x, std::int64_t y);

    const NetSetting& setting_;
    LabelPlanes planes_;
    Int3 lo_{};  ///< of the block
    Int3 hi_{};
    Int3 first_{};  ///< range of cells processed around it
    Int3 end_{};
    Int3 plane_nodes_{};
    std::vector<NetLayer> layers_;                   ///< of the last cells along z, cyclic
    std::vector<std::vector<std::int64_t>> labels_;  ///< of the last planes of nodes, cyclic
    /// Slim nodes of the planes below and above the newest layer.
    std::array<std::vector<std::uint8_t>, 2> slim_;
    std::vector<NetPiece> pieces_;  ///< pieces that intersect the emitted layer
    struct Wanted {
        std::int64_t label = kOutsideLabel;
        bool is = false;
    };
    std::array<Wanted, 64> known_{};
};

}  // namespace isonest::detail
