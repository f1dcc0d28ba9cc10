#include "store/container/parts/footer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <initializer_list>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "store/bytes/store_bytes.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kFooterVersion = 1;
/// Size of HDF5's superblock, version 2 or 3.
constexpr std::uint64_t kSuperblockBytes = 48;
/// A catalogue has a few bytes for each page of the chunk table.
constexpr std::uint64_t kMaxCatalogueBytes = std::uint64_t{64} << 20U;
constexpr std::array<char, 8> kFooterMagic{'I', 's', 'o', 'N', 'e', 's', 't', '\n'};

/// The footer as stored.
struct StoredFooter {
    Footer footer;
    std::uint32_t version = kFooterVersion;
    std::uint32_t bytes = kFooterBytes;
    std::uint64_t xxh64 = 0;  ///< of everything before it
    std::array<char, 8> magic = kFooterMagic;

    [[nodiscard]] std::uint64_t sum() const {
        return checksum_of(std::as_bytes(std::span(this, 1)).first(offsetof(StoredFooter, xxh64)));
    }
};
static_assert(sizeof(StoredFooter) == kFooterBytes);

[[noreturn]] void fail_footer(const StoreBytes& bytes, const std::string& problem) {
    throw Error(ErrorKind::corrupt, {bytes.name(), "footer"}, problem,
                {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
}

}  // namespace

std::vector<std::byte> bytes_behind_hdf5(std::uint64_t hdf5_end,
                                         std::span<const std::byte> catalogue) {
    StoredFooter last;
    last.footer.hdf5_end = hdf5_end;
    last.footer.catalogue = (hdf5_end + 7) / 8 * 8;
    last.footer.catalogue_bytes = catalogue.size();
    last.footer.catalogue_xxh64 = checksum_of(catalogue);
    last.footer.file_bytes = last.footer.catalogue + catalogue.size() + kFooterBytes;
    last.xxh64 = last.sum();
    std::vector<std::byte> bytes(last.footer.catalogue - hdf5_end);
    bytes.insert(bytes.end(), catalogue.begin(), catalogue.end());
    const auto footer = std::as_bytes(std::span(&last, 1));
    bytes.insert(bytes.end(), footer.begin(), footer.end());
    return bytes;
}

/// See "Disk Format: Level 0A" of HDF5's file format specification: superblocks 2 and 3.
std::optional<std::uint64_t> hdf5_end_of(const StoreBytes& bytes) {
    constexpr std::array<unsigned char, 8> kSignature{0x89, 'H', 'D', 'F', '\r', '\n', 0x1A, '\n'};
    constexpr std::size_t kVersionAt = 8;
    constexpr std::size_t kSizeOfOffsetsAt = 9;
    constexpr std::size_t kEndAt = 28;
    if (bytes.size() < kSuperblockBytes) {
        return std::nullopt;
    }
    const HeldBytes held = bytes.read(0, kSuperblockBytes);
    const std::byte* const block = held.bytes().data();
    const auto version = std::to_integer<int>(block[kVersionAt]);
    if (std::memcmp(block, kSignature.data(), kSignature.size()) != 0 || version < 2 ||
        version > 3 || block[kSizeOfOffsetsAt] != std::byte{sizeof(std::uint64_t)}) {
        return std::nullopt;
    }
    std::uint64_t end = 0;
    std::memcpy(&end, block + kEndAt, sizeof(end));
    return end;
}

std::optional<FoundCatalogue> find_catalogue(const StoreBytes& bytes) {
    const std::uint64_t size = bytes.size();
    if (size < kFooterBytes) {
        return std::nullopt;
    }
    FoundCatalogue found;
    if (!bytes.is_remote()) {
        // Requests both at once; of a file that is not in the page cache, nothing else is read.
        const std::uint64_t tail = std::min(size, kRemoteTail);
        const std::array<ByteRange, 2> first{
            {{0, std::min(size, kSuperblockBytes)}, {size - tail, tail}}};
        bytes.want(first);
    }
    found.tail_begin = size - std::min(size, bytes.is_remote() ? kRemoteTail : kFooterBytes);
    found.tail = bytes.read(found.tail_begin, size - found.tail_begin);
    StoredFooter stored;
    std::memcpy(&stored, found.tail.bytes().last(kFooterBytes).data(), kFooterBytes);
    if (stored.magic != kFooterMagic || stored.version != kFooterVersion) {
        return std::nullopt;
    }
    if (!bytes.is_remote() && hdf5_end_of(bytes) != stored.footer.hdf5_end) {
        return std::nullopt;
    }
    if (stored.xxh64 != stored.sum() || stored.bytes != kFooterBytes) {
        fail_footer(bytes, "damaged: checksum mismatch: its bytes have changed");
    }
    const Footer& footer = found.footer = stored.footer;
    const std::uint64_t end = size - kFooterBytes;
    if (footer.file_bytes != size || footer.catalogue > end ||
        footer.catalogue_bytes > end - footer.catalogue || footer.hdf5_end > footer.catalogue) {
        fail_footer(bytes, "it belongs to another file, or bytes of this one are missing");
    }
    if (footer.catalogue_bytes > kMaxCatalogueBytes) {
        fail_footer(bytes, "damaged: invalid length of the catalogue");
    }
    found.bytes =
        footer.catalogue >= found.tail_begin
            ? HeldBytes(nullptr, found.tail.bytes().subspan(footer.catalogue - found.tail_begin,
                                                            footer.catalogue_bytes))
            : bytes.read(footer.catalogue, footer.catalogue_bytes);
    std::optional<Catalogue> catalogue;
    if (checksum_of(found.bytes.bytes()) == footer.catalogue_xxh64) {
        catalogue = parse_catalogue(found.bytes.bytes());
    }
    if (!catalogue) {
        fail_footer(bytes, "its catalogue is damaged");
    }
    found.catalogue = std::move(*catalogue);
    return found;
}

namespace {

enum class Tag : std::uint32_t { attribute = 1, table = 2, ranges = 3, names = 4, totals = 5 };

/// Precedes the content of each record.
struct RecordHead {
    std::uint32_t tag = 0;
    std::uint32_t detail = 0;  ///< kind of the attribute, or level of the ranges
    std::uint64_t bytes = 0;   ///< of the content, without the padding to a multiple of 8
};
static_assert(sizeof(RecordHead) == 16);

constexpr std::size_t kNameBytes = 32;
constexpr std::uint64_t kRowBytes = 40;
constexpr std::size_t kSum = sizeof(std::uint64_t);
constexpr std::uint64_t kMaxLevel = 64;

std::uint64_t filled(std::uint64_t bytes) {
    return (bytes + 7) / 8 * 8;
}

class Records {
  public:
    void add(Tag tag, std::uint32_t detail, std::uint64_t bytes) {
        const RecordHead head{static_cast<std::uint32_t>(tag), detail, bytes};
        put(std::as_bytes(std::span(&head, 1)));
    }
    void put(std::span<const std::byte> bytes) {
        out.insert(out.end(), bytes.begin(), bytes.end());
        out.resize(filled(out.size()));
    }
    void put(std::initializer_list<std::uint64_t> numbers) {
        put(std::as_bytes(std::span(numbers.begin(), numbers.size())));
    }
    std::vector<std::byte> out;
};

/// The numbers at the start of a record; nullopt if it is shorter.
template <std::size_t N>
std::optional<std::array<std::uint64_t, N>> numbers_of(std::span<const std::byte> content) {
    std::array<std::uint64_t, N> numbers{};
    if (content.size() < sizeof(numbers)) {
        return std::nullopt;
    }
    std::memcpy(numbers.data(), content.data(), sizeof(numbers));
    return numbers;
}

/// `count` checksums starting at `from`; nullopt if there are fewer.
std::optional<std::span<const std::byte>> sums_of(std::span<const std::byte> content,
                                                  std::size_t from, std::uint64_t count) {
    if (count > (content.size() - from) / kSum) {
        return std::nullopt;
    }
    return content.subspan(from, count * kSum);
}

bool parse_attribute(std::uint32_t kind, std::span<const std::byte> content, Catalogue& out) {
    if (content.size() < kNameBytes) {
        return false;
    }
    std::string_view name(reinterpret_cast<const char*>(content.data()), kNameBytes);
    name = name.substr(0, name.find('\0'));
    if (kind >= static_cast<std::uint32_t>(AttributeKind::u32) &&
        kind <= static_cast<std::uint32_t>(AttributeKind::text)) {
        out.attributes.push_back(
            {name, static_cast<AttributeKind>(kind), content.subspan(kNameBytes)});
    }
    return true;
}

bool parse_table(std::span<const std::byte> content, Catalogue& out) {
    const auto numbers = numbers_of<6>(content);
    if (!numbers || out.table) {
        return false;
    }
    const auto [offset, rows, row_bytes, rows_of_page, pages, xxh64] = *numbers;
    const auto sums = sums_of(content, sizeof(*numbers), pages);
    if (row_bytes != kRowBytes || rows_of_page < 1 || rows_of_page > kMaxRowsOfPage || !sums ||
        rows == 0 || pages != (rows - 1) / rows_of_page + 1) {
        return false;
    }
    out.table = {offset, rows, rows_of_page, xxh64, *sums};
    return true;
}

bool parse_ranges(std::uint32_t level, std::span<const std::byte> content, Catalogue& out) {
    const auto numbers = numbers_of<3>(content);
    if (!numbers || level > kMaxLevel ||
        (!out.ranges.empty() && static_cast<int>(level) <= out.ranges.back().level)) {
        return false;
    }
    const auto [offset, bytes, planes] = *numbers;
    const auto sums = sums_of(content, sizeof(*numbers), planes);
    if (!sums) {
        return false;
    }
    out.ranges.push_back({static_cast<int>(level), offset, bytes, *sums});
    return true;
}

bool parse_names(std::span<const std::byte> content, Catalogue& out) {
    const auto numbers = numbers_of<4>(content);
    if (!numbers || out.names) {
        return false;
    }
    out.names = {(*numbers)[0], (*numbers)[1], (*numbers)[2], (*numbers)[3]};
    return true;
}

bool parse_totals(std::span<const std::byte> content, Catalogue& out) {
    if (!out.totals.empty() || content.size() % sizeof(ArrayTotals) != 0) {
        return false;
    }
    out.totals.resize(content.size() / sizeof(ArrayTotals));
    std::memcpy(out.totals.data(), content.data(), content.size());
    return true;
}

}  // namespace

const CatalogueAttribute* Catalogue::find(std::string_view name) const {
    const auto found =
        std::find_if(attributes.begin(), attributes.end(),
                     [&](const CatalogueAttribute& attribute) { return attribute.name == name; });
    return found == attributes.end() ? nullptr : &*found;
}

const ArrayTotals* Catalogue::totals_of(std::uint64_t first_row, std::uint64_t chunks) const {
    const auto found = std::find_if(totals.begin(), totals.end(), [&](const ArrayTotals& of) {
        return of.first_row == first_row && of.chunks == chunks;
    });
    return found == totals.end() ? nullptr : &*found;
}

std::optional<Catalogue> parse_catalogue(std::span<const std::byte> bytes) {
    Catalogue out;
    while (!bytes.empty()) {
        RecordHead head;
        if (bytes.size() < sizeof(head)) {
            return std::nullopt;
        }
        std::memcpy(&head, bytes.data(), sizeof(head));
        bytes = bytes.subspan(sizeof(head));
        if (head.bytes > bytes.size() || filled(head.bytes) > bytes.size()) {
            return std::nullopt;
        }
        const auto content = bytes.first(head.bytes);
        bytes = bytes.subspan(filled(head.bytes));
        bool good = true;
        switch (static_cast<Tag>(head.tag)) {
            case Tag::attribute:
                good = parse_attribute(head.detail, content, out);
                break;
            case Tag::table:
                good = parse_table(content, out);
                break;
            case Tag::ranges:
                good = parse_ranges(head.detail, content, out);
                break;
            case Tag::names:
                good = parse_names(content, out);
                break;
            case Tag::totals:
                good = parse_totals(content, out);
                break;
            default:
                break;  // of a later version
        }
        if (!good) {
            return std::nullopt;
        }
    }
    return out;
}

std::vector<std::byte> catalogue_bytes(const Catalogue& catalogue) {
    Records records;
    for (const CatalogueAttribute& attribute : catalogue.attributes) {
        records.add(Tag::attribute, static_cast<std::uint32_t>(attribute.kind),
                    kNameBytes + attribute.bytes.size());
        std::array<char, kNameBytes> name{};
        attribute.name.copy(name.data(), name.size());
        records.put(std::as_bytes(std::span(name)));
        records.put(attribute.bytes);
    }
    if (catalogue.table) {
        const CatalogueTable& table = *catalogue.table;
        records.add(Tag::table, 0, 6 * sizeof(std::uint64_t) + table.sums.size());
        records.put({table.offset, table.rows, kRowBytes, table.rows_of_page,
                     table.sums.size() / kSum, table.xxh64});
        records.put(table.sums);
    }
    for (const CatalogueRanges& ranges : catalogue.ranges) {
        records.add(Tag::ranges, static_cast<std::uint32_t>(ranges.level),
                    3 * sizeof(std::uint64_t) + ranges.sums.size());
        records.put({ranges.offset, ranges.bytes, ranges.sums.size() / kSum});
        records.put(ranges.sums);
    }
    if (catalogue.names) {
        const CatalogueNames& names = *catalogue.names;
        records.add(Tag::names, 0, 4 * sizeof(std::uint64_t));
        records.put({names.offset, names.rows, names.row_bytes, names.xxh64});
    }
    records.add(Tag::totals, 0, catalogue.totals.size() * sizeof(ArrayTotals));
    records.put(std::as_bytes(std::span(catalogue.totals)));
    return std::move(records.out);
}

ChunkTable::ChunkTable(const StoreBytes& bytes, const FoundCatalogue& found)
    : pages_(std::make_unique<Pages>()) {
    const CatalogueTable& table = *found.catalogue.table;
    const std::uint64_t pages = table.sums.size() / sizeof(std::uint64_t);
    pages_->bytes = &bytes;
    pages_->found = &found;
    if (bytes.is_remote()) {
        const std::uint64_t most = kMaxHeld / (table.rows_of_page * sizeof(ChunkRow));
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
                "damaged: checksum mismatch: its bytes have changed",
                {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
}

ChunkRow ChunkTable::row(std::uint64_t number) const {
    if (pages_ != nullptr && pages_->seen == nullptr) {
        return remote_row(number);
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

ChunkRow ChunkTable::remote_row(std::uint64_t number) const {
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
    std::vector<std::uint64_t> rows;  // one per page
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
