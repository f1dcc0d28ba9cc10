// Writes a store: chunks in any order, then the table. It appears complete under its name or not at
// all.
#pragma once

#include <filesystem>
#include <memory>
#include <span>

#include <isonest/label_name.h>

#include "store/container/chunk_source.h"

namespace isonest::detail {

/// How chunks get into the file.
enum class ChunkWriting {
    here,      ///< by write_chunk()
    elsewhere  ///< by others, at the places chosen by plan_chunk()
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
    /// Appends one encoded chunk. `row` provides flags, min and max; offset, size and checksum are
    /// filled in. REQUIRES: each chunk of a non-alias array is written exactly once. Throws
    /// Error{io}.
    void write_chunk(const ArrayInfo& array, const Int3& chunk, std::span<const std::byte> encoded,
                     ChunkRow row);
    /// The chunk table, for planned chunks: the caller fills in everything except the offsets.
    [[nodiscard]] std::span<ChunkRow> rows();
    /// Chooses the place of a chunk whose row contains its size, as write_chunk() would if called
    /// for the same chunks in the same order, and fills in the offset. REQUIRES:
    /// ChunkWriting::elsewhere; each chunk of a non-alias array exactly once. Throws Error{io}.
    void plan_chunk(const ArrayInfo& array, const Int3& chunk);
    /// Writes the ranges of a level's cubes, [z][y][x]. REQUIRES: called once for each level that
    /// has ranges, in ascending order, after all chunks. Throws Error{io}.
    void write_cube_ranges(int level, std::span<const CubeRange> ranges);
    /// Writes names and colours of labels, by ascending ids. REQUIRES: called once if the header
    /// says that there are label names, after all chunks. Throws Error{io}, and
    /// Error{invalid_argument} for invalid names.
    void write_label_names(std::span<const LabelName> names);
    /// What the positions of a curvilinear grid are as a whole. REQUIRES: called once for such a
    /// grid, after their chunks; the type is that of the header.
    void set_curved(const CurvedNodes& nodes);
    [[nodiscard]] ChunkRow row(const ArrayInfo& array, const Int3& chunk) const override;
    void decode(const ArrayInfo& array, const Int3& chunk, std::span<std::byte> raw) const override;
    [[nodiscard]] std::uint64_t bytes_written() const;

    /// Name of the unfinished file.
    [[nodiscard]] const std::filesystem::path& temporary() const;
    /// Keeps the unfinished file.
    void keep();
    /// Writes the table and the completeness mark, syncs and renames. Throws Error{io}.
    void finish();

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

/// To be called at the start of main(): HDF5 then closes nothing at exit. All files are closed by
/// their owners; without this call, HDF5 1.10 would repeat a failed close (full disk) at exit, and
/// crash.
void leave_hdf5_alone_at_exit();

}  // namespace isonest::detail
