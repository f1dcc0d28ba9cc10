// Writes a store: chunks in any order, then the table; whole under its name or not at all.
#pragma once

#include <filesystem>
#include <memory>
#include <span>

#include <isonest/label_name.h>

#include "store/container/chunk_source.h"

namespace isonest::detail {

/// Who writes the chunks of a store into its file.
enum class ChunkWriting {
    here,      ///< write_chunk()
    elsewhere  ///< others, where plan_chunk() says
};

/// A store that is being written under a temporary name beside its final one.
/// Thread-safety: write_chunk(), row() and decode() from any thread; the rest from one.
class StoreWriter : public ChunkSource {
  public:
    /// Throws what check_output() throws, and Error{io}.
    StoreWriter(const std::filesystem::path& path, const StoreHeader& header, bool force,
                ChunkWriting chunks = ChunkWriting::here);
    /// Removes the temporary file unless finish() succeeded or keep() was called.
    ~StoreWriter() override;

    [[nodiscard]] const StoreLayout& layout() const override;
    /// Appends one encoded chunk. `row` brings flags, min and max; offset, size and checksum are
    /// filled in. REQUIRES: each chunk of a non-alias array exactly once.
    /// Throws Error{io}.
    void write_chunk(const ArrayInfo& array, const Int3& chunk, std::span<const std::byte> encoded,
                     ChunkRow row);
    /// The chunk table, for planned chunks: whoever plans fills in all but the offsets.
    [[nodiscard]] std::span<ChunkRow> rows();
    /// Chooses the place of a chunk whose row has its size, as write_chunk() would if it was called
    /// for the same chunks in the same order, and fills in the offset. REQUIRES:
    /// ChunkWriting::elsewhere; each chunk of a non-alias array exactly once. Throws Error{io}.
    void plan_chunk(const ArrayInfo& array, const Int3& chunk);
    /// The ranges of a level's cubes, [z][y][x]. REQUIRES: once for each level that has them, in
    /// ascending order, after all chunks. Throws Error{io}.
    void write_cube_ranges(int level, std::span<const CubeRange> ranges);
    /// Names and colours of labels. REQUIRES: once if the header says that there are some, after
    /// all chunks; by rising ids. Throws Error{io}, and Error{invalid_argument} for what cannot be
    /// one.
    void write_label_names(std::span<const LabelName> names);
    [[nodiscard]] ChunkRow row(const ArrayInfo& array, const Int3& chunk) const override;
    void decode(const ArrayInfo& array, const Int3& chunk, std::span<std::byte> raw) const override;
    [[nodiscard]] std::uint64_t bytes_written() const;

    /// The unfinished file's name.
    [[nodiscard]] const std::filesystem::path& temporary() const;
    /// The unfinished file stays.
    void keep();
    /// Writes table and completeness mark, syncs, renames. Throws Error{io}.
    void finish();

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

/// For main(), before anything else: HDF5 then closes nothing at exit. All of isonest's files are
/// closed by their owners; without this call, HDF5 1.10 would try a close that failed (a full disk)
/// once more at exit, and crash.
void leave_hdf5_alone_at_exit();

}  // namespace isonest::detail
