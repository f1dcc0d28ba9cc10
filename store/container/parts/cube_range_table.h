// The ranges of cubes and the names of labels in the file of a store.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include <isonest/label_name.h>

#include "store/bytes/store_bytes.h"
#include "store/container/format.h"
#include "store/container/parts/footer.h"

namespace isonest::detail {

// The ranges of cubes in the file of a store.

/// The checksum of a plane of cubes is verified at the first access. For a remote store, only
/// levels whose ranges take at most kMaxRemote bytes are read, all of them at the first access.
/// Ranges only save work, and those of finer levels can be larger than the chunks that they would
/// save (for 2049^3 nodes of one byte, 32 MiB on level 3, 64 KiB on level 6). Thread-safety: const
/// methods from any thread.
class CubeRangeTable {
  public:
    static constexpr std::uint64_t kMaxRemote = std::uint64_t{256} << 10U;

    CubeRangeTable() = default;
    /// Takes the places from HDF5's structures; `file`: the HDF5 handle of the open store. `bytes`
    /// must outlive this object. Throws Error{corrupt, io}.
    CubeRangeTable(std::int64_t file, const StoreLayout& layout, const StoreBytes& bytes);
    /// Takes the places from the catalogue, which must outlive this object, like `bytes`. Throws
    /// Error{corrupt, io}.
    CubeRangeTable(const Catalogue& catalogue, const StoreLayout& layout, const StoreBytes& bytes);

    /// Nullopt if the level has no ranges, if they are not read, and outside the volume. Throws
    /// Error{corrupt, io}.
    [[nodiscard]] std::optional<CubeRange> at(int level, const Int3& cube) const;
    /// The ranges of all cubes of a plane, x fastest, also if at() does not read them. REQUIRES:
    /// the level has ranges and such a plane. Throws Error{corrupt, io}.
    [[nodiscard]] std::vector<CubeRange> plane(int level, std::int64_t z) const;
    /// Tells a remote store that all planes of a level are needed soon.
    void want(int level) const;

  private:
    struct Level {
        Int3 cells;
        std::uint64_t plane_bytes = 0;
        std::uint64_t offset = 0;
        HeldBytes sums;
        HeldBytes ranges;                           ///< of a remote store: read later
        bool is_read = true;                        ///< false: never read
        std::unique_ptr<std::atomic<bool>[]> seen;  ///< planes whose checksum was verified

        [[nodiscard]] std::uint64_t bytes() const {
            return static_cast<std::uint64_t>(cells.z) * plane_bytes;
        }
        [[nodiscard]] ByteRange plane(std::int64_t z) const {
            return {offset + static_cast<std::uint64_t>(z) * plane_bytes, plane_bytes};
        }
    };
    /// `offset`: of the ranges; nullopt if they do not match the layout.
    void add(const StoreLayout& layout, int level, std::optional<std::uint64_t> offset,
             HeldBytes sums);
    void require_whole(const Level& l, int level, std::int64_t z) const;
    [[noreturn]] void fail_plane(int level, std::int64_t z) const;
    static std::uint64_t sum_of(const Level& l, std::int64_t z);
    [[nodiscard]] CubeRange range_in(std::span<const std::byte> bytes, std::int64_t cube) const;
    [[nodiscard]] HeldBytes read_plane(const Level& l, int level, std::int64_t z) const;
    void read_remote() const;

    const StoreBytes* bytes_ = nullptr;
    ValueType type_ = ValueType::f32;
    mutable std::vector<Level> levels_;     ///< from kFirstRangeLevel on
    std::unique_ptr<std::once_flag> read_;  ///< of a remote store: reading the ranges
};

// The names and colours of labels in a store: FORMAT.md, section 3.

/// Offsets of the members in a row.
struct LabelRow {
    static constexpr std::size_t kId = 0;
    static constexpr std::size_t kFlags = kId + sizeof(std::int64_t);
    static constexpr std::size_t kColor = kFlags + 1;
    static constexpr std::size_t kName = kColor + std::tuple_size_v<LabelColor>;
};

/// Rows as stored. Thread-safety: const methods from any thread.
class LabelTable {
  public:
    /// Path of the dataset.
    static constexpr const char* kPath = "/label_names";

    LabelTable() = default;
    /// Throws Error{corrupt, io}. REQUIRES: `bytes` outlives this.
    LabelTable(const CatalogueNames& place, const StoreBytes& bytes);

    /// Finds the rows through HDF5's structures. `file`: HDF5 identifier of the file, `name`: of
    /// the store, for messages. REQUIRES: the dataset exists. Throws Error{corrupt}.
    static CatalogueNames find(std::int64_t file, const std::string& name);

    [[nodiscard]] std::size_t size() const;
    /// Rows are sorted by ascending ids. REQUIRES: i < size().
    [[nodiscard]] LabelName at(std::size_t i) const;
    /// Nullopt if the table has no such label.
    [[nodiscard]] std::optional<LabelName> find(std::int64_t id) const;

  private:
    [[nodiscard]] std::int64_t id_at(std::size_t i) const;

    [[nodiscard]] std::span<const std::byte> rows() const { return held_.bytes(); }

    HeldBytes held_;
    std::size_t row_bytes_ = 1;
};

/// Throws Error{corrupt} about the label names of the store with this name.
[[noreturn]] void names_damaged(const std::string& store, const std::string& problem);
inline constexpr const char* kOtherNamesForm = "its layout is not that of the format";

/// Length in bytes of the longest of these names, at least 1.
std::size_t name_bytes_of(std::span<const LabelName> names);
/// The rows as stored.
std::vector<std::byte> label_rows(std::span<const LabelName> names, std::size_t name_bytes);

}  // namespace isonest::detail
