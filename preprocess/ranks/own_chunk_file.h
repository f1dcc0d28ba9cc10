// The encoded chunks that a rank has made, until their places in the store are known.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "preprocess/levels/indicator_chunks.h"
#include "store/container/format.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Where chunks lie one behind the other in a file.
struct ChunkRun {
    int descriptor = -1;
    std::uint64_t offset = 0;
};

/// Two temporary files: the chunks' bytes one behind the other, and their rows of the chunk table
/// in the same order. Some chunks may lie in other files. Thread-safety: one thread.
class OwnChunkFile {
  public:
    explicit OwnChunkFile(const ScratchFolder& folder) : bytes_(folder), rows_(folder) {}
    /// Appends chunks whose rows are whole but for the offset. Throws Error{io}.
    void add(std::span<const EncodedChunk> chunks);
    /// As that, of chunks that lie elsewhere, in a file that is open until write_into() is done.
    /// Throws Error{io}.
    void add(std::span<const EncodedChunk> chunks, const ChunkRun& place);
    /// All rows, mapped; after that none may be added. Throws Error{io}.
    std::span<ChunkRow> rows();
    /// Writes all chunks to where their rows say, and syncs the file to disk. Returns how many
    /// bytes that were. Throws Error{io}.
    std::uint64_t write_into(const std::filesystem::path& store) const;

  private:
    /// Rows whose chunks lie one behind the other.
    struct Run {
        ChunkRun place;
        std::uint64_t rows = 0;
        std::uint64_t bytes = 0;
    };
    void flush();

    ScratchFile bytes_;
    ScratchFile rows_;
    std::uint64_t end_ = 0;    ///< of bytes_
    std::uint64_t count_ = 0;  ///< rows in rows_
    std::vector<ChunkRow> pending_;
    std::vector<Run> runs_;
};

}  // namespace isonest::detail
