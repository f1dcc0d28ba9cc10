// The last bytes of a store, which point to its catalogue: FORMAT.md, "Footer and catalogue".
#pragma once

#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "store/bytes/store_bytes.h"
#include "store/container/format.h"

namespace isonest::detail {

// Everything needed to open a store, in one block of bytes: FORMAT.md, "Footer and catalogue".

/// Rows of the chunk table that share a checksum: 10,240 bytes.
inline constexpr std::uint64_t kRowsOfPage = 256;
/// A reader rejects larger pages.
inline constexpr std::uint64_t kMaxRowsOfPage = 65536;

/// The type in which the numbers of an attribute are stored.
enum class AttributeKind : std::uint32_t { u32 = 1, u64 = 2, f64 = 3, text = 4 };

/// An attribute of the root group.
struct CatalogueAttribute {
    std::string_view name;
    AttributeKind kind = AttributeKind::text;
    std::span<const std::byte> bytes;
};

/// Position of the chunk table.
struct CatalogueTable {
    std::uint64_t offset = 0;
    std::uint64_t rows = 0;
    std::uint64_t rows_of_page = kRowsOfPage;
    std::uint64_t xxh64 = 0;          ///< of all rows
    std::span<const std::byte> sums;  ///< u64 each: XXH64 of the pages
};

/// Position of the ranges of a level's cubes.
struct CatalogueRanges {
    int level = 0;
    std::uint64_t offset = 0;
    std::uint64_t bytes = 0;
    std::span<const std::byte> sums;  ///< u64 each: XXH64 of the planes
};

/// Position of the label names.
struct CatalogueNames {
    std::uint64_t offset = 0;
    std::uint64_t rows = 0;
    std::uint64_t row_bytes = 0;
    std::uint64_t xxh64 = 0;
};

/// Totals over the rows of an array's chunks.
struct ArrayTotals {
    std::uint64_t first_row = 0;  ///< of the chunk table
    std::uint64_t chunks = 0;
    std::uint64_t bytes = 0;  ///< stored
    double min = std::numeric_limits<double>::infinity();
    double max = -std::numeric_limits<double>::infinity();

    /// Adds the row of one chunk.
    void add(const ChunkRow& row) {
        bytes += row.bytes;
        min = std::fmin(min, row.min);
        max = std::fmax(max, row.max);
    }
};
static_assert(sizeof(ArrayTotals) == 40);

/// The parts of a catalogue, as views of its bytes.
struct Catalogue {
    std::vector<CatalogueAttribute> attributes;
    std::optional<CatalogueTable> table;
    std::vector<CatalogueRanges> ranges;  ///< by ascending levels
    std::optional<CatalogueNames> names;
    std::vector<ArrayTotals> totals;  ///< of the stored arrays, in the order of their rows

    [[nodiscard]] const CatalogueAttribute* find(std::string_view name) const;
    /// The totals of the array whose chunks have these rows.
    [[nodiscard]] const ArrayTotals* totals_of(std::uint64_t first_row, std::uint64_t chunks) const;
};

/// Nullopt if the bytes are not a catalogue. Unknown records are skipped. Whether the numbers are
/// valid for the file is not checked.
std::optional<Catalogue> parse_catalogue(std::span<const std::byte> bytes);

/// The bytes of a catalogue. REQUIRES: attribute names of at most 32 bytes.
std::vector<std::byte> catalogue_bytes(const Catalogue& catalogue);

inline constexpr std::size_t kFooterBytes = 64;
/// Bytes read from the end of a remote store before anything else is known.
inline constexpr std::uint64_t kRemoteTail = 65536;

struct Footer {
    std::uint64_t catalogue = 0;  ///< offset
    std::uint64_t catalogue_bytes = 0;
    std::uint64_t catalogue_xxh64 = 0;
    std::uint64_t hdf5_end = 0;    ///< of HDF5's part of the file, according to its superblock
    std::uint64_t file_bytes = 0;  ///< including the footer
};

/// The bytes after HDF5's part of a file: zeros up to a multiple of 8, the catalogue, the footer.
std::vector<std::byte> bytes_behind_hdf5(std::uint64_t hdf5_end,
                                         std::span<const std::byte> catalogue);

/// A catalogue in a file.
struct FoundCatalogue {
    Footer footer;
    HeldBytes tail;                ///< the end of the file, read to find the catalogue
    std::uint64_t tail_begin = 0;  ///< in the file
    HeldBytes bytes;               ///< of the catalogue; `catalogue` refers to them
    Catalogue catalogue;
};

/// The end of HDF5's part of the file, according to its superblock; nullopt if the superblock is
/// not of the kind that stores have.
std::optional<std::uint64_t> hdf5_end_of(const StoreBytes& bytes);

/// Nullopt if the file does not end with a footer, or the footer has another version, or, for a
/// local file, HDF5's part now ends elsewhere: HDF5's own structures then describe the store.
/// Throws Error{corrupt} if footer or catalogue are damaged, and Error{io}.
std::optional<FoundCatalogue> find_catalogue(const StoreBytes& bytes);

// Reads the chunk table as a whole, or page by page.

/// Rows of the table. The checksum of a page is verified at the first access to one of its rows.
/// For a local store, nothing is copied or locked. For a remote store, requested pages are kept, up
/// to kMaxHeld bytes; pages that share a slot replace each other.
/// Thread-safety: const methods from any thread.
class ChunkTable {
  public:
    /// All 512 pages of a volume of 2049^3 nodes. Included in kLibraryHeap.
    static constexpr std::size_t kMaxHeld = std::size_t{5} << 20U;

    ChunkTable() = default;
    /// From rows that are known to be undamaged.
    explicit ChunkTable(HeldBytes rows) : rows_(std::move(rows)) {}
    /// REQUIRES: found.catalogue.table lies in the file; both arguments outlive this object.
    ChunkTable(const StoreBytes& bytes, const FoundCatalogue& found);

    /// REQUIRES: the row exists. Throws Error{corrupt} if its page is damaged, and Error{io}.
    [[nodiscard]] ChunkRow row(std::uint64_t number) const;
    /// Tells a remote store that these rows are needed soon, and together.
    void want(std::span<const std::uint64_t> rows) const;
    /// The same for the chunks in [begin, end) of an array. If there are more pages than can be
    /// kept, only the first are requested. REQUIRES: the chunks are in the array's grid.
    void want(const ArrayInfo& array, const Int3& begin, const Int3& end) const;

  private:
    struct Held {
        std::uint64_t page = ~std::uint64_t{0};
        std::unique_ptr<std::byte[]> bytes;
    };
    struct Pages {
        const StoreBytes* bytes = nullptr;
        const FoundCatalogue* found = nullptr;
        std::unique_ptr<std::atomic<bool>[]> seen;  ///< of a local store: pages whose checksum was
                                                    ///< verified
        std::mutex mutex;
        std::vector<Held> held;  ///< of a remote store: page p is in slot p % held.size()
    };
    [[nodiscard]] ByteRange range_of(std::uint64_t page) const;
    [[nodiscard]] std::uint64_t sum_of(std::uint64_t page) const;
    [[noreturn]] void fail_page(std::uint64_t page) const;
    [[nodiscard]] ChunkRow remote_row(std::uint64_t number) const;

    HeldBytes rows_;                ///< empty for a remote store with a footer
    std::unique_ptr<Pages> pages_;  ///< null: all rows are known to be undamaged
};

}  // namespace isonest::detail
