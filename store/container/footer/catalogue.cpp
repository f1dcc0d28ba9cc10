#include "store/container/footer/catalogue.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <initializer_list>
#include <utility>

namespace isonest::detail {
namespace {

enum class Tag : std::uint32_t { attribute = 1, table = 2, ranges = 3, names = 4, totals = 5 };

/// Before the content of each record.
struct RecordHead {
    std::uint32_t tag = 0;
    std::uint32_t detail = 0;  ///< kind of the attribute, or level of the ranges
    std::uint64_t bytes = 0;   ///< of the content, without what fills it up to a multiple of 8
};
static_assert(sizeof(RecordHead) == 16);

constexpr std::size_t kNameBytes = 32;
constexpr std::uint64_t kRowBytes = 40;
constexpr std::size_t kSum = sizeof(std::uint64_t);
constexpr std::uint64_t kMostLevel = 64;

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

/// The numbers at the start of a record; nothing if it is shorter.
template <std::size_t N>
std::optional<std::array<std::uint64_t, N>> numbers_of(std::span<const std::byte> content) {
    std::array<std::uint64_t, N> numbers{};
    if (content.size() < sizeof(numbers)) {
        return std::nullopt;
    }
    std::memcpy(numbers.data(), content.data(), sizeof(numbers));
    return numbers;
}

/// `count` checksums from there on; nothing if there are fewer.
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
    if (row_bytes != kRowBytes || rows_of_page < 1 || rows_of_page > kMostRowsOfPage || !sums ||
        rows == 0 || pages != (rows - 1) / rows_of_page + 1) {
        return false;
    }
    out.table = {offset, rows, rows_of_page, xxh64, *sums};
    return true;
}

bool parse_ranges(std::uint32_t level, std::span<const std::byte> content, Catalogue& out) {
    const auto numbers = numbers_of<3>(content);
    if (!numbers || level > kMostLevel ||
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

}  // namespace isonest::detail
