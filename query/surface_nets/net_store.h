// The pieces of a surface net in a temporary file, until all are known and a mesh can be made of
// each label.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <mutex>
#include <span>
#include <vector>

#include "query/surface_nets/net_piece.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Where a label's part of a piece lies.
struct LabelPartRecord {
    std::int64_t label = 0;
    std::int64_t piece = 0;
    std::uint64_t piece_at = 0;  ///< bytes in the file
    std::uint64_t part_at = 0;
    std::uint64_t first_vertex = 0;  ///< set by seal(): vertices of the label in pieces before
    std::uint32_t piece_vertices = 0;
    std::uint32_t vertices = 0;
    std::uint32_t quads = 0;
    std::uint32_t no_area = 0;
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    float moved = 0;
    std::uint32_t piece_quads = 0;
};

/// Where a piece lies, and what is known of all labels in it.
struct NetPieceRecord {
    std::int64_t piece = 0;
    std::uint64_t at = 0;            ///< bytes in the file
    std::uint64_t first_vertex = 0;  ///< set by seal(): vertices of pieces before
    std::uint64_t first_quad = 0;
    std::uint32_t vertices = 0;
    std::uint32_t quads = 0;
    std::uint32_t no_area = 0;  ///< triangles
    float moved = 0;            ///< as of a LabelPart
    std::array<float, 3> lo{};
    std::array<float, 3> hi{};
    /// The smallest and the largest label beside its quads, if they have sides.
    std::int64_t least = std::numeric_limits<std::int64_t>::max();
    std::int64_t most = std::numeric_limits<std::int64_t>::min();
};

/// What a label shares with another one in a piece.
struct SharedRecord {
    SharedArea shared;
    std::int64_t piece = 0;
};

/// Thread-safety: append() from any thread; seal() from one, after it; the rest from any.
class NetStore {
  public:
    /// `pieces`: along each axis. `sides`: whether those that are appended have sides.
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

    /// All that are not empty, in their order.
    [[nodiscard]] std::span<const NetPieceRecord> all_pieces() const { return all_pieces_; }
    [[nodiscard]] std::span<const std::array<float, 3>> positions(const NetPieceRecord& r) const;
    [[nodiscard]] std::span<const std::uint16_t> codes(const NetPieceRecord& r) const;
    [[nodiscard]] std::span<const NetQuad> quads(const NetPieceRecord& r) const;
    /// One for each quad. REQUIRES: they have sides.
    [[nodiscard]] std::span<const NetSides> sides(const NetPieceRecord& r) const;

    /// Of a label, in the order of the pieces; empty if it has no surface.
    [[nodiscard]] std::span<const LabelPartRecord> parts(std::int64_t label) const;
    /// What it shares with each label that it touches, by their ids.
    [[nodiscard]] std::vector<SharedArea> shared(std::int64_t label) const;
    /// What labels share, sorted by them, by the others, and by pieces.
    [[nodiscard]] std::span<const SharedRecord> all_shared() const { return all_shared_; }
    // Of the piece that a part is of.
    [[nodiscard]] std::span<const std::array<float, 3>> positions(const LabelPartRecord& r) const;
    [[nodiscard]] std::span<const std::uint16_t> codes(const LabelPartRecord& r) const;
    [[nodiscard]] std::span<const NetQuad> quads(const LabelPartRecord& r) const;
    // Of the part, as in a LabelPart.
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
