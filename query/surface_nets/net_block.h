// The surface net of all labels in a block of cells: layer after layer, each moved as soon as those
// beside it are there.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include <isonest/int3.h>

#include "query/surface_nets/label_planes.h"
#include "query/surface_nets/net_layer.h"
#include "query/surface_nets/net_piece.h"

namespace isonest::detail {

/// Cell c of an axis with n nodes lies between the nodes c - 1 and c; 0 and n are those that the
/// volume's border passes through, which is half a node's distance beyond the last nodes.
struct NetSetting {
    Int3 nodes{};
    Double3 spacing{1, 1, 1};
    Double3 origin{};
    int passes = 0;       ///< how often vertices are moved
    bool closed = false;  ///< labels are closed at the volume's border, else open there
    std::span<const std::int64_t> wanted = {};  ///< labels that get a mesh, ascending
    /// Quads keep the labels on both sides, and what labels share counts what is no label.
    bool sides = false;

    [[nodiscard]] Int3 cells() const { return nodes + Int3{1, 1, 1}; }
    /// Cells around a block that its vertices depend on, and those that its quads need.
    [[nodiscard]] std::int64_t halo() const { return passes + 1; }
};

/// The weight of pass number `pass` of `passes`, by which vertices go to the mean of their
/// neighbours. Three of four go 0.6 of the way, and the fourth as far back as those three went, so
/// that what is large keeps its size and only what is small is smoothed away; the last three always
/// go forth. Source: G. Taubin, "A signal processing approach to fair surface design", SIGGRAPH
/// 1995, with the weights of his two steps in equal sums.
float weight_of_pass(int pass, int passes);

/// Thread-safety: none; one for each thread, reused.
class NetBlock {
  public:
    /// `store`: its name. What is given must outlive it.
    NetBlock(const NetSetting& setting, ChunkCache& cache, const std::string& store)
        : setting_(setting), planes_(cache, store) {}

    /// Hands the pieces in the cells [lo, hi) to `done`, one after the other; it may be empty.
    /// REQUIRES: lo is a multiple of kPieceCells; hi too, or where the cells end. Throws what
    /// LabelPlanes and `done` throw.
    void make(const Int3& lo, const Int3& hi, const std::function<void(const NetPiece&)>& done);

    /// Bytes of heap that one needs for blocks of such an edge, at most.
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
    Int3 first_{};  ///< cell of what is looked at around it
    Int3 end_{};
    Int3 plane_nodes_{};
    std::vector<NetLayer> layers_;                   ///< of the last cells along z, in turn
    std::vector<std::vector<std::int64_t>> labels_;  ///< of the last planes of nodes, in turn
    /// Slim nodes of the planes below and above the newest layer.
    std::array<std::vector<std::uint8_t>, 2> slim_;
    std::vector<NetPiece> pieces_;  ///< that the layer which is emitted passes
    struct Wanted {
        std::int64_t label = kOutsideLabel;
        bool is = false;
    };
    std::array<Wanted, 64> known_{};
};

}  // namespace isonest::detail
