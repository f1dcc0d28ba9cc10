// The chunk table as it is read: whole, or page by page.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <utility>
#include <vector>

#include "store/bytes/store_bytes.h"
#include "store/container/footer/footer.h"
#include "store/container/format.h"

namespace isonest::detail {

/// Rows of the table. A page is compared with its checksum when a row of it is first asked for. Of
/// a store that is not far, nothing is copied and nothing locked. Of one that is, pages that were
/// asked for are kept: at most kMostHeld bytes, those that share a place replace each other.
/// Thread-safety: const methods from any thread.
class ChunkTable {
  public:
    /// All 512 pages of a volume of 2049^3 nodes. It is part of kLibraryHeap.
    static constexpr std::size_t kMostHeld = std::size_t{5} << 20U;

    ChunkTable() = default;
    /// Rows that are whole.
    explicit ChunkTable(HeldBytes rows) : rows_(std::move(rows)) {}
    /// REQUIRES: found.catalogue.table lies in the file; both outlive this.
    ChunkTable(const StoreBytes& bytes, const FoundCatalogue& found);

    /// REQUIRES: there is such a row. Throws Error{corrupt} if its page is damaged, Error{io}.
    [[nodiscard]] ChunkRow row(std::uint64_t number) const;
    /// Tells a store that is far that these rows are needed soon, and together.
    void want(std::span<const std::uint64_t> rows) const;
    /// The same of the chunks in [begin, end) of an array, as far as their pages are kept: first
    /// come first. REQUIRES: its grid has them.
    void want(const ArrayInfo& array, const Int3& begin, const Int3& end) const;

  private:
    struct Held {
        std::uint64_t page = ~std::uint64_t{0};
        std::unique_ptr<std::byte[]> bytes;
    };
    struct Pages {
        const StoreBytes* bytes = nullptr;
        const FoundCatalogue* found = nullptr;
        std::unique_ptr<std::atomic<bool>[]> seen;  ///< of a store that is not far: whole pages
        std::mutex mutex;
        std::vector<Held> held;  ///< of one that is far: page p in place p % held.size()
    };
    [[nodiscard]] ByteRange range_of(std::uint64_t page) const;
    [[nodiscard]] std::uint64_t sum_of(std::uint64_t page) const;
    [[noreturn]] void fail_page(std::uint64_t page) const;
    [[nodiscard]] ChunkRow far_row(std::uint64_t number) const;

    HeldBytes rows_;                ///< of a store that is far and has a footer: none
    std::unique_ptr<Pages> pages_;  ///< null: all rows are known to be whole
};

}  // namespace isonest::detail
