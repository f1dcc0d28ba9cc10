// The encoded chunks that a rank has made, until their places in the store are known.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "preprocess/levels/indicator_chunks.h"
#include "store/container/format.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Two temporary files: the chunks' bytes one behind the other, and their rows of the chunk table
/// in the same order. Thread-safety: one thread.
class OwnChunkFile {
  public:
    explicit OwnChunkFile(const ScratchFolder& folder) : bytes_(folder), rows_(folder) {}
    /// With a name for the bytes, which keep() leaves there.
    OwnChunkFile(const ScratchFolder& folder, const std::filesystem::path& name)
        : bytes_(ScratchFile::named(name)), rows_(folder) {}
    void keep() { bytes_.keep(); }
    /// The bytes; for those with a name. Throws Error{io}.
    void sync() const { bytes_.sync(); }
    /// How many bytes there are.
    [[nodiscard]] std::uint64_t end() const { return end_; }
    /// Appends one whose row is whole but for the offset. Throws Error{io}.
    void add(const EncodedChunk& chunk);
    /// All rows, mapped; after that none may be added. Throws Error{io}.
    std::span<ChunkRow> rows();
    /// Writes all chunks to where their rows say, and syncs the file to disk. Returns how many
    /// bytes that were. Throws Error{io}.
    std::uint64_t write_into(const std::filesystem::path& store) const;

  private:
    void flush();

    ScratchFile bytes_;
    ScratchFile rows_;
    std::uint64_t end_ = 0;    ///< of bytes_
    std::uint64_t count_ = 0;  ///< rows in rows_
    std::vector<ChunkRow> pending_;
};

}  // namespace isonest::detail
