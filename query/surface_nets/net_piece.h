// The part of a surface net in a fixed box of cells, and what each label has of it.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include <isonest/int3.h>

namespace isonest::detail {

/// Cells of a piece along each axis. Pieces tile the cells from the first one on, whatever the
/// chunks, the memory and the blocks in which they are made; meshes are put together from them in
/// the order of their numbers.
inline constexpr Int3 kPieceCells{32, 32, 8};
inline constexpr std::uint32_t kMostPieceCells = 32 * 32 * 8;

/// A corner of a quad: the number of a vertex of the piece, or, with kForeign, the code of a cell
/// of the piece before this one along the axes whose bits are set from kBeforeBit on.
using NetCorner = std::uint32_t;
inline constexpr NetCorner kForeign = 1U << 31U;
inline constexpr unsigned kBeforeBit = 13;
static_assert(kMostPieceCells == 1U << kBeforeBit);

/// Around an edge between two nodes whose labels differ, in the four cells there; seen from the
/// second node, corners come counterclockwise.
struct NetQuad {
    std::array<NetCorner, 4> corner{};
    std::uint32_t diagonal = 0;  ///< 0: between the corners 0 and 2; 1: between 1 and 3
};

/// The labels of the two nodes of the edge that a quad is around, as in a CellLabels.
using NetSides = std::array<std::int64_t, 2>;

/// Its triangles, as places of corners.
inline std::array<std::array<std::uint8_t, 3>, 2> triangles_of(const NetQuad& quad) {
    using Places = std::array<std::array<std::uint8_t, 3>, 2>;
    return quad.diagonal == 0 ? Places{{{0, 1, 2}, {0, 2, 3}}} : Places{{{0, 1, 3}, {1, 2, 3}}};
}

/// The cell of the piece's cell (x, y, z), as one number.
inline std::uint16_t code_of(const Int3& cell) {
    return static_cast<std::uint16_t>(kPieceCells.linear(cell));
}

/// What the mesh of a label shares with that of another one.
struct SharedArea {
    std::int64_t label = 0;
    std::int64_t other = 0;  ///< kOutsideLabel: with all that is no label
    double area = 0;         ///< square world units
};

/// What is known of the part that a label has of a piece.
struct LabelPart {
    std::int64_t label = 0;
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    /// The furthest that one of its vertices is from the centre of its cell, world units.
    float moved = 0;
    std::uint32_t no_area = 0;            ///< triangles
    std::vector<std::uint16_t> vertices;  ///< ascending
    /// In order; kReversed where the label is that of the edge's second node.
    std::vector<std::uint32_t> quads;
    static constexpr std::uint32_t kReversed = 1U << 31U;
};

/// Collected cell by cell. Thread-safety: none.
class NetPiece {
  public:
    /// Forgets everything. `number`: of the piece among all.
    void begin(std::int64_t number);
    [[nodiscard]] std::int64_t number() const { return number_; }
    [[nodiscard]] bool empty() const { return positions_.empty() && quads_.empty(); }

    /// The number of the vertex in cell `code`. Codes come in ascending order.
    std::uint32_t add_vertex(std::uint16_t code, const std::array<float, 3>& position);
    /// That the vertex is one of this label's. REQUIRES: once for each vertex and label.
    void add_to_label(std::int64_t label, std::uint32_t vertex, float moved);
    /// `no_area`: how many of its triangles have none.
    std::uint32_t add_quad(const NetQuad& quad, std::uint32_t no_area);
    /// Of the quad that came last. REQUIRES: of all quads, or of none.
    void add_sides(const NetSides& sides) { sides_.push_back(sides); }
    /// That the quad is one of this label's.
    void add_quad_to_label(std::int64_t label, std::uint32_t quad, bool reversed,
                           std::uint32_t no_area);

    /// That two labels, of which the first has a mesh, share an area.
    void add_shared(const SharedArea& shared) { shared_.push_back(shared); }

    [[nodiscard]] std::span<const SharedArea> shared() const { return shared_; }
    [[nodiscard]] std::span<const std::array<float, 3>> positions() const { return positions_; }
    [[nodiscard]] std::span<const std::uint16_t> codes() const { return codes_; }
    [[nodiscard]] std::span<const NetQuad> quads() const { return quads_; }
    [[nodiscard]] std::span<const NetSides> sides() const { return sides_; }
    [[nodiscard]] std::uint32_t no_area() const { return no_area_; }
    [[nodiscard]] std::span<const LabelPart> labels() const { return {labels_.data(), used_}; }

    /// Bytes of heap, at most: vectors grow to twice of what is in them, and a label has a node of
    /// the piece.
    static constexpr std::uint64_t kMostBytes =
        kMostPieceCells *
            (2 * (12 + 2 + 3 * sizeof(NetQuad) + 6 * sizeof(SharedArea)) + 2 * (8 * 2 + 6 * 4)) +
        (kMostPieceCells + 2000) * (sizeof(LabelPart) + 64);
    /// On top of that, if the quads have sides.
    static constexpr std::uint64_t kMostSideBytes =
        kMostPieceCells * std::uint64_t{2 * 3 * sizeof(NetSides)};

  private:
    LabelPart& part_of(std::int64_t label);
    std::int64_t number_ = 0;
    std::vector<std::array<float, 3>> positions_;
    std::vector<std::uint16_t> codes_;
    std::vector<NetQuad> quads_;
    std::vector<NetSides> sides_;
    std::uint32_t no_area_ = 0;
    std::vector<SharedArea> shared_;
    std::vector<LabelPart> labels_;  ///< the first used_ of them
    std::size_t used_ = 0;
    std::unordered_map<std::int64_t, std::size_t> place_;
    std::size_t last_ = 0;  ///< of what was asked for
};

}  // namespace isonest::detail
