#include "store/container/footer/chunk_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <optional>
#include <utility>

#include <isonest/error.h>

#include "store/bytes/read_whole.h"
#include "store/container/codec.h"

namespace isonest::detail {

ChunkTable::ChunkTable(const StoreBytes& bytes, const FoundCatalogue& found)
    : pages_(std::make_unique<Pages>()) {
    const CatalogueTable& table = *found.catalogue.table;
    const std::uint64_t pages = table.sums.size() / sizeof(std::uint64_t);
    pages_->bytes = &bytes;
    pages_->found = &found;
    if (bytes.is_far()) {
        const std::uint64_t most = kMostHeld / (table.rows_of_page * sizeof(ChunkRow));
        pages_->held.resize(std::clamp<std::uint64_t>(most, 1, pages));
    } else {
        pages_->seen = std::make_unique<std::atomic<bool>[]>(pages);
        rows_ = bytes.read(table.offset, table.rows * sizeof(ChunkRow));
    }
}

ByteRange ChunkTable::range_of(std::uint64_t page) const {
    const CatalogueTable& table = *pages_->found->catalogue.table;
    const std::uint64_t first = page * table.rows_of_page;
    return {table.offset + first * sizeof(ChunkRow),
            std::min(table.rows_of_page, table.rows - first) * sizeof(ChunkRow)};
}

std::uint64_t ChunkTable::sum_of(std::uint64_t page) const {
    std::uint64_t sum = 0;
    std::memcpy(&sum, pages_->found->catalogue.table->sums.data() + page * sizeof(sum),
                sizeof(sum));
    return sum;
}

void ChunkTable::fail_page(std::uint64_t page) const {
    throw Error(ErrorKind::corrupt,
                {pages_->bytes->name(), fmt::format("chunk table, page {}", page)},
                "damaged: its bytes are not those that were written",
                {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
}

ChunkRow ChunkTable::row(std::uint64_t number) const {
    if (pages_ != nullptr && pages_->seen == nullptr) {
        return far_row(number);
    }
    if (pages_ != nullptr) {
        const std::uint64_t page = number / pages_->found->catalogue.table->rows_of_page;
        if (!pages_->seen[page].load(std::memory_order_relaxed)) {
            const ByteRange range = range_of(page);
            const std::uint64_t begin = range.offset - pages_->found->catalogue.table->offset;
            if (checksum_of(rows_.bytes().subspan(begin, range.size)) != sum_of(page)) {
                fail_page(page);
            }
            pages_->seen[page].store(true, std::memory_order_relaxed);
        }
    }
    ChunkRow row;
    std::memcpy(&row, rows_.bytes().data() + number * sizeof(row), sizeof(row));
    return row;
}

ChunkRow ChunkTable::far_row(std::uint64_t number) const {
    const CatalogueTable& table = *pages_->found->catalogue.table;
    const std::uint64_t page = number / table.rows_of_page;
    const std::uint64_t at = number % table.rows_of_page * sizeof(ChunkRow);
    Held& held = pages_->held[page % pages_->held.size()];
    ChunkRow row;
    {
        const std::lock_guard lock(pages_->mutex);
        if (held.page == page) {
            std::memcpy(&row, held.bytes.get() + at, sizeof(row));
            return row;
        }
    }
    const ByteRange range = range_of(page);
    const FoundCatalogue& found = *pages_->found;
    std::optional<HeldBytes> read;
    if (range.offset >= found.tail_begin) {
        read.emplace(nullptr,
                     found.tail.bytes().subspan(range.offset - found.tail_begin, range.size));
    }
    if (!read || checksum_of(read->bytes()) != sum_of(page)) {
        read = read_whole(*pages_->bytes, range, sum_of(page));
    }
    if (!read) {
        fail_page(page);
    }
    auto copy = std::make_unique_for_overwrite<std::byte[]>(range.size);
    std::copy(read->bytes().begin(), read->bytes().end(), copy.get());
    std::memcpy(&row, copy.get() + at, sizeof(row));
    const std::lock_guard lock(pages_->mutex);
    held.page = page;
    held.bytes = std::move(copy);
    return row;
}

void ChunkTable::want(std::span<const std::uint64_t> rows) const {
    if (pages_ == nullptr || pages_->seen != nullptr) {
        return;
    }
    const std::uint64_t of_page = pages_->found->catalogue.table->rows_of_page;
    std::vector<std::uint64_t> pages;
    for (const std::uint64_t row : rows) {
        pages.push_back(row / of_page);
    }
    std::sort(pages.begin(), pages.end());
    pages.erase(std::unique(pages.begin(), pages.end()), pages.end());
    std::vector<ByteRange> ranges;
    {
        const std::lock_guard lock(pages_->mutex);
        for (const std::uint64_t page : pages) {
            const ByteRange range = range_of(page);
            if (pages_->held[page % pages_->held.size()].page != page &&
                range.offset < pages_->found->tail_begin) {
                ranges.push_back(range);
            }
        }
    }
    if (!ranges.empty()) {
        pages_->bytes->want(ranges);
    }
}

void ChunkTable::want(const ArrayInfo& array, const Int3& begin, const Int3& end) const {
    if (pages_ == nullptr || pages_->seen != nullptr || begin.x >= end.x) {
        return;
    }
    const std::uint64_t of_page = pages_->found->catalogue.table->rows_of_page;
    const std::size_t most = pages_->held.size();
    std::vector<std::uint64_t> rows;  // one of each page
    for (std::int64_t z = begin.z; z < end.z && rows.size() < most; ++z) {
        for (std::int64_t y = begin.y; y < end.y && rows.size() < most; ++y) {
            std::uint64_t page = array.row_of({begin.x, y, z}) / of_page;
            const std::uint64_t last = array.row_of({end.x - 1, y, z}) / of_page;
            if (!rows.empty()) {
                page = std::max(page, rows.back() / of_page + 1);
            }
            for (; page <= last && rows.size() < most; ++page) {
                rows.push_back(page * of_page);
            }
        }
    }
    want(rows);
}

}  // namespace isonest::detail
