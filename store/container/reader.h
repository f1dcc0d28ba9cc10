// Opens a finished store by its catalogue, or through HDF5 if there is none.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "store/bytes/store_bytes.h"
#include "store/container/chunk_source.h"
#include "store/container/parts/cube_range_table.h"
#include "store/container/parts/footer.h"
#include "store/container/parts/header_reader.h"

namespace isonest::detail {

/// A finished store. No HDF5 calls are made after the constructor, and none at all if the store has
/// a footer. Thread-safety: const methods from any thread.
class StoreReader : public ChunkSource {
  public:
    /// Throws Error{not_found}, Error{corrupt} (no HDF5 file, incomplete, damaged table),
    /// Error{invalid_argument} (another HDF5 file), Error{unsupported} (something that another
    /// version may understand, by name: FORMAT.md, section 2).
    explicit StoreReader(const std::filesystem::path& path);
    /// Throws the same, and Error{io}.
    explicit StoreReader(std::shared_ptr<const StoreBytes> bytes);

    /// The path of the file, or the name of the bytes.
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] const StoreLayout& layout() const override { return layout_; }
    /// The format version in which the store was written.
    [[nodiscard]] const FormatVersion& version() const { return version_; }
    [[nodiscard]] std::uint64_t file_bytes() const { return bytes_->size(); }
    [[nodiscard]] const StoreBytes& bytes() const { return *bytes_; }
    /// Null if the store was opened through HDF5.
    [[nodiscard]] const FoundCatalogue* catalogue() const { return found_ ? &*found_ : nullptr; }
    /// Smallest and largest finite value of level 0; min > max if there is none.
    [[nodiscard]] double min_value() const { return range_[0]; }
    [[nodiscard]] double max_value() const { return range_[1]; }
    [[nodiscard]] bool has_missing() const { return has_missing_ != 0; }
    /// Names and colours of labels.
    [[nodiscard]] const LabelTable& label_names() const { return label_names_; }
    /// XXH64 of the chunk table, which contains the checksums of all chunks: differs for stores
    /// with different values.
    [[nodiscard]] std::uint64_t identity() const { return identity_; }
    /// Totals over the rows of an array. If the store has a footer, no rows are read. Throws
    /// Error{corrupt, io}.
    [[nodiscard]] ArrayTotals totals(const ArrayInfo& array) const;

    /// The row, checked against the file's size. Throws Error{corrupt, io}.
    [[nodiscard]] ChunkRow row(const ArrayInfo& array, const Int3& chunk) const override;
    /// The stored bytes of a chunk; for a local file a view of its map. Throws Error{corrupt, io}.
    [[nodiscard]] HeldBytes stored(const ArrayInfo& array, const Int3& chunk) const;
    void decode(const ArrayInfo& array, const Int3& chunk, std::span<std::byte> raw) const override;
    void prefetch(const ArrayInfo& array, const Int3& chunk) const override;
    [[nodiscard]] bool is_remote() const override { return bytes_->is_remote(); }
    /// For a remote store, waits for the required part of the chunk table.
    void prefetch_all(std::span<const WantedChunk> chunks) const override;
    void prefetch_rows(const ArrayInfo& array, const Int3& begin, const Int3& end) const override {
        table_.want(array, begin, end);
    }
    /// For a remote store, only for coarse levels: see CubeRangeTable.
    [[nodiscard]] std::optional<CubeRange> cube_range(int level, const Int3& cube) const override;
    /// The ranges of a plane of cubes, x fastest, also where cube_range() returns nothing.
    /// REQUIRES: the level has ranges and such a plane. Throws Error{corrupt, io}.
    [[nodiscard]] std::vector<CubeRange> cube_ranges(int level, std::int64_t z) const {
        return ranges_.plane(level, z);
    }
    /// Tells a remote store that all ranges of a level are needed soon.
    void prefetch_cube_ranges(int level) const { ranges_.want(level); }
    /// Compares the header's range and has_missing with the chunk table. Throws Error{corrupt}.
    void compare_range() const;

  private:
    [[noreturn]] void fail_corrupt(const std::string& inside, const std::string& problem) const;
    void open_by_catalogue();
    void open_by_hdf5();
    void take_header(const RootAttributes& root);
    void read_table(std::int64_t root);

    std::filesystem::path path_;
    std::shared_ptr<const StoreBytes> bytes_;
    std::optional<FoundCatalogue> found_;
    StoreLayout layout_;
    FormatVersion version_;
    std::array<double, 2> range_{};
    std::uint64_t has_missing_ = 0;
    std::uint64_t identity_ = 0;
    ChunkTable table_;
    CubeRangeTable ranges_;
    LabelTable label_names_;
};

}  // namespace isonest::detail
