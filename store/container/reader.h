// Opens a finished store: the header through HDF5, then everything through a read-only map.
#pragma once

#include <array>
#include <filesystem>

#include "store/container/chunk_source.h"
#include "store/container/cube_range_table.h"
#include "store/container/label_table.h"
#include "store/files/mapped_file.h"

namespace isonest::detail {

/// A finished store. After the constructor there is no HDF5 call.
/// Thread-safety: const methods from any thread.
class StoreReader : public ChunkSource {
  public:
    /// Throws Error{not_found}, Error{corrupt} (not a store, incomplete, damaged table),
    /// Error{unsupported} (what another version may mean, by name: FORMAT.md, section 2).
    explicit StoreReader(const std::filesystem::path& path);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] const StoreLayout& layout() const override { return layout_; }
    /// Of the format in which it was written.
    [[nodiscard]] const FormatVersion& version() const { return version_; }
    [[nodiscard]] std::uint64_t file_bytes() const { return file_.bytes().size(); }
    /// Smallest and largest finite value of level 0; min > max if there is none.
    [[nodiscard]] double min_value() const { return range_[0]; }
    [[nodiscard]] double max_value() const { return range_[1]; }
    [[nodiscard]] bool has_missing() const { return has_missing_; }
    /// Names and colours of labels.
    [[nodiscard]] const LabelTable& label_names() const { return label_names_; }
    /// XXH64 of the chunk table, which holds the checksums of all chunks: tells stores of other
    /// values apart.
    [[nodiscard]] std::uint64_t identity() const;

    /// The row, checked against the file's size. Throws Error{corrupt}.
    [[nodiscard]] ChunkRow row(const ArrayInfo& array, const Int3& chunk) const override;
    /// The stored bytes of a chunk, in the map.
    [[nodiscard]] std::span<const std::byte> stored(const ArrayInfo& array,
                                                    const Int3& chunk) const;
    void decode(const ArrayInfo& array, const Int3& chunk, std::span<std::byte> raw) const override;
    void prefetch(const ArrayInfo& array, const Int3& chunk) const override;
    [[nodiscard]] std::optional<CubeRange> cube_range(int level, const Int3& cube) const override;

  private:
    [[noreturn]] void fail_corrupt(const std::string& inside, const std::string& problem) const;
    void map_table(std::int64_t root);
    void compare_range(std::uint64_t has_missing) const;

    std::filesystem::path path_;
    MappedFile file_;
    StoreLayout layout_;
    FormatVersion version_;
    std::array<double, 2> range_{};
    bool has_missing_ = false;
    std::span<const std::byte> table_;  ///< the chunk table
    CubeRangeTable ranges_;
    LabelTable label_names_;
};

}  // namespace isonest::detail
