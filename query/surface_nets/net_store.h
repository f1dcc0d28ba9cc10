// Stores the pieces of a surface net in a temporary file until all are complete and a mesh can be
// made for each label.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <mutex>
#include <span>
#include <unordered_map>
#include <vector>

#include <isonest/int3.h>

#include "store/files/scratch_file.h"

namespace isonest::detail {

// The part of a surface net in a fixed box of cells, and each label's share of it.

/// Cells of a piece along each axis. Pieces tile the cells starting at the first one, independent
/// of chunks, memory and blocks; meshes are assembled from them in the order of their numbers.
inline constexpr Int3 kPieceCells{32, 32, 8};
inline constexpr std::uint32_t kMaxPieceCells = 32 * 32 * 8;

/// A corner of a quad: the number of a vertex of the piece or, with kForeign, the code of a cell of
/// the piece before this one along the axes whose bits are set, starting at kBeforeBit.
using NetCorner = std::uint32_t;
inline constexpr NetCorner kForeign = 1U << 31U;
inline constexpr unsigned kBeforeBit = 13;
static_assert(kMaxPieceCells == 1U << kBeforeBit);

/// A quad around an edge between two nodes with different labels, with corners in the four cells
/// there; counterclockwise seen from the second node.
struct NetQuad {
    std::array<NetCorner, 4> corner{};
    std::uint32_t diagonal = 0;  ///< 0: between the corners 0 and 2; 1: between 1 and 3
};

/// The labels of the two nodes of a quad's edge, as in a CellLabels.
using NetSides = std::array<std::int64_t, 2>;

/// The triangles of a quad, as indices of corners.
inline std::array<std::array<std::uint8_t, 3>, 2> triangles_of(const NetQuad& quad) {
    using Places = std::array<std::array<std::uint8_t, 3>, 2>;
    return quad.diagonal == 0 ? Places{{{0, 1, 2}, {0, 2, 3}}} : Places{{{0, 1, 3}, {1, 2, 3}}};
}

/// Code of the piece's cell (x, y, z).
inline std::uint16_t code_of(const Int3& cell) {
    return static_cast<std::uint16_t>(kPieceCells.linear(cell));
}

/// The area that the mesh of a label shares with that of another one.
struct SharedArea {
    std::int64_t label = 0;
    std::int64_t other = 0;  ///< kOutsideLabel: all unlabelled space
    double area = 0;         ///< square world units
};

/// A label's part of a piece.
struct LabelPart {
    std::int64_t label = 0;
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    /// Maximum distance of one of its vertices from the centre of its cell, world units.
    float moved = 0;
    std::uint32_t no_area = 0;            ///< triangles
    std::vector<std::uint16_t> vertices;  ///< ascending
    /// In order; with kReversed if the label is that of the edge's second node.
    std::vector<std::uint32_t> quads;
    static constexpr std::uint32_t kReversed = 1U << 31U;
};

/// Collected cell by cell. Thread-safety: none.
class NetPiece {
  public:
    /// Resets the piece. `number`: of the piece among all pieces.
    void begin(std::int64_t number);
    [[nodiscard]] std::int64_t number() const { return number_; }
    [[nodiscard]] bool empty() const { return positions_.empty() && quads_.empty(); }

    /// Adds the vertex of cell `code` and returns its number. Codes must be ascending.
    std::uint32_t add_vertex(std::uint16_t code, const std::array<float, 3>& position);
    /// Assigns the vertex to a label. REQUIRES: once for each vertex and label.
    void add_to_label(std::int64_t label, std::uint32_t vertex, float moved);
    /// `no_area`: number of its triangles without area.
    std::uint32_t add_quad(const NetQuad& quad, std::uint32_t no_area);
    /// Sets the sides of the last quad. REQUIRES: called for all quads, or for none.
    void add_sides(const NetSides& sides) { sides_.push_back(sides); }
    /// Assigns the quad to a label.
    void add_quad_to_label(std::int64_t label, std::uint32_t quad, bool reversed,
                           std::uint32_t no_area);

    /// Records an area shared by two labels, the first of which has a mesh.
    void add_shared(const SharedArea& shared) { shared_.push_back(shared); }

    [[nodiscard]] std::span<const SharedArea> shared() const { return shared_; }
    [[nodiscard]] std::span<const std::array<float, 3>> positions() const { return positions_; }
    [[nodiscard]] std::span<const std::uint16_t> codes() const { return codes_; }
    [[nodiscard]] std::span<const NetQuad> quads() const { return quads_; }
    [[nodiscard]] std::span<const NetSides> sides() const { return sides_; }
    [[nodiscard]] std::uint32_t no_area() const { return no_area_; }
    [[nodiscard]] std::span<const LabelPart> labels() const { return {labels_.data(), used_}; }

    /// Maximum heap, bytes: vectors grow to twice their contents, and a label has a node of the
    /// piece.
    static constexpr std::uint64_t kMaxBytes =
        kMaxPieceCells *
            (2 * (12 + 2 + 3 * sizeof(NetQuad) + 6 * sizeof(SharedArea)) + 2 * (8 * 2 + 6 * 4)) +
        (kMaxPieceCells + 2000) * (sizeof(LabelPart) + 64);
    /// In addition, if the quads have sides.
    static constexpr std::uint64_t kMaxSideBytes =
        kMaxPieceCells * std::uint64_t{2 * 3 * sizeof(NetSides)};

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
    std::size_t last_ = 0;  ///< index of the last request
};

/// Location of a label's part of a piece.
struct LabelPartRecord {
    std::int64_t label = 0;
    std::int64_t piece = 0;
    std::uint64_t piece_at = 0;  ///< bytes in the file
    std::uint64_t part_at = 0;
    std::uint64_t first_vertex = 0;  ///< set by seal(): number of the label's vertices in earlier
                                     ///< pieces
    std::uint32_t piece_vertices = 0;
    std::uint32_t vertices = 0;
    std::uint32_t quads = 0;
    std::uint32_t no_area = 0;
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    float moved = 0;
    std::uint32_t piece_quads = 0;
};

/// Location of a piece, with totals over all labels in it.
struct NetPieceRecord {
    std::int64_t piece = 0;
    std::uint64_t at = 0;            ///< bytes in the file
    std::uint64_t first_vertex = 0;  ///< set by seal(): number of vertices in earlier pieces
    std::uint64_t first_quad = 0;
    std::uint32_t vertices = 0;
    std::uint32_t quads = 0;
    std::uint32_t no_area = 0;  ///< triangles
    float moved = 0;            ///< as in LabelPart
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    /// The smallest and the largest label at its quads, if they have sides.
    std::int64_t least = std::numeric_limits<std::int64_t>::max();
    std::int64_t most = std::numeric_limits<std::int64_t>::min();
};

/// An area shared by two labels in a piece.
struct SharedRecord {
    SharedArea shared;
    std::int64_t piece = 0;
};

/// Thread-safety: append() from any thread; then seal() from one thread; then the rest from any.
class NetStore {
  public:
    /// `pieces`: number along each axis. `sides`: whether appended pieces have sides.
    NetStore(const ScratchFolder& scratch, const Int3& pieces, bool sides = false)
        : pieces_(pieces),
          has_sides_(sides),
          file_(scratch),
          piece_file_(scratch),
          record_file_(scratch),
          shared_file_(scratch) {}
    [[nodiscard]] const Int3& pieces() const { return pieces_; }

    /// Throws Error{io}.
    void append(const NetPiece& piece);
    /// Ends the appending. Throws Error{io}.
    void seal();

    /// All pieces that are not empty, in order.
    [[nodiscard]] std::span<const NetPieceRecord> all_pieces() const { return all_pieces_; }
    [[nodiscard]] std::span<const std::array<float, 3>> positions(const NetPieceRecord& r) const;
    [[nodiscard]] std::span<const std::uint16_t> codes(const NetPieceRecord& r) const;
    [[nodiscard]] std::span<const NetQuad> quads(const NetPieceRecord& r) const;
    /// One for each quad. REQUIRES: the pieces have sides.
    [[nodiscard]] std::span<const NetSides> sides(const NetPieceRecord& r) const;

    /// The parts of a label, in the order of the pieces; empty if it has no surface.
    [[nodiscard]] std::span<const LabelPartRecord> parts(std::int64_t label) const;
    /// The areas shared with each label that it touches, sorted by id.
    [[nodiscard]] std::vector<SharedArea> shared(std::int64_t label) const;
    /// All shared areas, sorted by label, by the other label, and by piece.
    [[nodiscard]] std::span<const SharedRecord> all_shared() const { return all_shared_; }
    // Data of the piece to which a part belongs.
    [[nodiscard]] std::span<const std::array<float, 3>> positions(const LabelPartRecord& r) const;
    [[nodiscard]] std::span<const std::uint16_t> codes(const LabelPartRecord& r) const;
    [[nodiscard]] std::span<const NetQuad> quads(const LabelPartRecord& r) const;
    // Data of the part, as in LabelPart.
    [[nodiscard]] std::span<const std::uint16_t> part_vertices(const LabelPartRecord& r) const;
    [[nodiscard]] std::span<const std::uint32_t> part_quads(const LabelPartRecord& r) const;

  private:
    template <class T>
    [[nodiscard]] std::span<const T> slice(std::uint64_t at, std::uint64_t count) const {
        return {reinterpret_cast<const T*>(data_.data() + at), static_cast<std::size_t>(count)};
    }
    Int3 pieces_;
    bool has_sides_;
    ScratchFile file_;
    ScratchFile piece_file_;
    ScratchFile record_file_;
    ScratchFile shared_file_;
    std::mutex mutex_;
    std::uint64_t end_ = 0;
    std::uint64_t piece_count_ = 0;
    std::uint64_t records_ = 0;
    std::uint64_t areas_ = 0;
    std::span<const std::byte> data_;
    std::span<NetPieceRecord> all_pieces_;
    std::span<LabelPartRecord> all_;
    std::span<SharedRecord> all_shared_;
};

}  // namespace isonest::detail
