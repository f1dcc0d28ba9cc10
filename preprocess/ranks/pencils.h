// How the blocks of the volume are divided among ranks.
//
// Blocks are distributed in *pencils*: all blocks with the same y and z, because sources read whole
// rows along x. Pencils of the base pass follow a Morton curve (G. M. Morton, "A Computer Oriented
// Geodetic Data Base", 1966), and each rank gets a piece of it. The pieces are compact, so that
// little is read or sent twice, and the pencils of coarser levels mostly lie on pencils of the same
// rank.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/levels/level_sink.h"
#include "store/container/format.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// The pass that makes levels 0 to 2; the passes of coarser levels have the number of their level.
inline constexpr int kBasePass = 2;

struct Pencil {
    std::int64_t y = 0;
    std::int64_t z = 0;
    bool operator==(const Pencil&) const = default;
};

/// Pencils of the base pass [y_begin, y_end) x [z_begin, z_end).
struct PencilBox {
    std::int64_t y_begin = 0;
    std::int64_t y_end = 0;
    std::int64_t z_begin = 0;
    std::int64_t z_end = 0;
    bool operator==(const PencilBox&) const = default;
};

/// How the rows of a level's cubes are divided: into pencils of 2^shift x 2^shift pencils of the
/// base pass, each with `cells` x `cells` rows of cubes. `grid`: number of pencils along y and z.
struct PencilCut {
    int shift = 0;
    std::int64_t cells = 1;
    Int3 grid{1, 1, 1};
};

/// The same on all ranks. Thread-safety: const methods from any thread. Takes a few bytes of memory
/// per rank.
class Pencils {
  public:
    /// The pieces of the curve have nearly the same number of nodes, including margins. A thin last
    /// pencil of an axis belongs to the one before it. REQUIRES: ranks >= 1. `layout` is borrowed.
    Pencils(const StoreLayout& layout, int ranks);

    /// Number of ranks.
    [[nodiscard]] int ranks() const { return static_cast<int>(first_.size()) - 1; }
    /// Blocks per axis of a pass.
    [[nodiscard]] Int3 grid(int pass) const;
    /// How a pass is divided into blocks, and so into chunks of the store.
    [[nodiscard]] PencilCut chunk_cut(int pass) const;
    /// How a pass is divided into what ranks compute. If a pencil of the base pass has at least two
    /// rows of cubes at this level, the parts are what lies on such pencils: parts of blocks, so
    /// that ranks only need margins from each other. On coarser levels, and with one rank, the
    /// parts are the blocks.
    [[nodiscard]] PencilCut part_cut(int pass) const;
    [[nodiscard]] bool has_parts(int pass) const {
        return part_cut(pass).shift < chunk_cut(pass).shift;
    }

    /// The owner of a pencil of a cut: the rank with its first pencil of the base pass.
    [[nodiscard]] int owner(const PencilCut& cut, const Pencil& pencil) const;
    /// The pencils of a rank, along the curve.
    [[nodiscard]] std::vector<Pencil> of(int rank, const PencilCut& cut) const;
    /// The same for blocks.
    [[nodiscard]] int owner(int pass, const Pencil& pencil) const {
        return owner(chunk_cut(pass), pencil);
    }
    [[nodiscard]] std::vector<Pencil> of(int rank, int pass) const {
        return of(rank, chunk_cut(pass));
    }
    /// The pencils of a rank in the base pass as few boxes, each of which is read at once.
    [[nodiscard]] std::vector<PencilBox> boxes(int rank) const;

  private:
    [[nodiscard]] std::uint64_t code_of(const Pencil& pencil) const;
    [[nodiscard]] Pencil pencil_at(std::uint64_t code) const;

    const StoreLayout* layout_;
    Int3 base_;     ///< blocks of the base pass
    Int3 dealt_;    ///< without the thin ones at the end of y or z
    int bits_ = 0;  ///< number of bits of y and z that alternate in a code; the remaining bits of
                    ///< the longer axis follow
    bool longer_is_y_ = true;
    std::vector<std::uint64_t> first_;  ///< first code of each rank; then the end of all codes
};

// The chunks that a rank makes, in the order in which it makes them.

struct ChunkPlace {
    const ArrayInfo* array = nullptr;
    Int3 chunk;
    bool operator==(const ChunkPlace&) const = default;
};

/// The pass after that of the coarsest level, if the coarsest level is at least kBasePass: it makes
/// the coarsest values, in one block of the rank with the first pencil. Else kBasePass.
int last_pass(const StoreLayout& layout);

/// The chunks that one block of a pass makes, in order.
std::vector<ChunkPlace> chunks_of(const StoreLayout& layout, int pass, const Int3& block);

/// Blocks of one pass that are computed together; x varies faster than y.
struct BlockRow {
    int pass = kBasePass;
    std::int64_t y_begin = 0;
    std::int64_t y_end = 0;
    std::int64_t z = 0;
};

/// A rank's rows of blocks, in order. Takes a few bytes of memory per pencil of a pass.
class OwnRows {
  public:
    OwnRows(const StoreLayout& layout, const Pencils& pencils, int rank);
    /// False after the last one.
    bool next(BlockRow& row);

  private:
    const StoreLayout* layout_;
    const Pencils* pencils_;
    int rank_;
    std::vector<PencilBox> boxes_;
    std::size_t box_ = 0;
    std::int64_t row_ = 0;  ///< in the box
    int pass_ = kBasePass;
    std::vector<Pencil> coarse_;  ///< pencils of a coarser pass
    std::size_t at_ = 0;
};

/// A rank's chunks, in order.
class OwnChunks {
  public:
    OwnChunks(const StoreLayout& layout, const Pencils& pencils, int rank)
        : layout_(&layout), pencils_(&pencils), rows_(layout, pencils, rank) {}
    /// False after the last one.
    bool next(ChunkPlace& place);

  private:
    const StoreLayout* layout_;
    const Pencils* pencils_;
    OwnRows rows_;
    BlockRow row_;
    Int3 size_{0, 0, 0};      ///< blocks of the row
    std::int64_t block_ = 0;  ///< the next one
    std::vector<ChunkPlace> chunks_;
    std::size_t chunk_ = 0;
};

// The encoded chunks that a rank has made, until their places in the store are known.

/// Position of adjacent chunks in a file.
struct ChunkRun {
    int descriptor = -1;
    std::uint64_t offset = 0;
};

/// Two temporary files: the bytes of the chunks, one after the other, and their rows of the chunk
/// table in the same order. Some chunks may be in other files. Thread-safety: one thread.
class OwnChunkFile {
  public:
    explicit OwnChunkFile(const ScratchFolder& folder) : bytes_(folder), rows_(folder) {}
    /// Appends chunks whose rows are complete except for the offset. Throws Error{io}.
    void add(std::span<const EncodedChunk> chunks);
    /// The same for chunks in another file, which stays open until write_into() is done. Throws
    /// Error{io}.
    void add(std::span<const EncodedChunk> chunks, const ChunkRun& place);
    /// All rows, mapped; no more can be added afterwards. Throws Error{io}.
    std::span<ChunkRow> rows();
    /// Writes all chunks to the offsets in their rows, and syncs the file to disk. Returns the
    /// number of bytes. Throws Error{io}.
    std::uint64_t write_into(const std::filesystem::path& store) const;

  private:
    /// Rows whose chunks are adjacent.
    struct Run {
        ChunkRun place;
        std::uint64_t rows = 0;
        std::uint64_t bytes = 0;
    };
    void flush();

    ScratchFile bytes_;
    ScratchFile rows_;
    std::uint64_t end_ = 0;    ///< end of bytes_
    std::uint64_t count_ = 0;  ///< number of rows in rows_
    std::vector<ChunkRow> pending_;
    std::vector<Run> runs_;
};

}  // namespace isonest::detail
