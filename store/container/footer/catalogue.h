// What opening a store needs, in one piece of bytes: FORMAT.md, "Footer and catalogue".
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "store/container/format.h"

namespace isonest::detail {

/// Rows of the chunk table that share a checksum: 10,240 bytes.
inline constexpr std::uint64_t kRowsOfPage = 256;
/// More than that a reader does not take for a page.
inline constexpr std::uint64_t kMostRowsOfPage = 65536;

/// As what the numbers of an attribute are stored.
enum class AttributeKind : std::uint32_t { u32 = 1, u64 = 2, f64 = 3, text = 4 };

/// An attribute of the root group.
struct CatalogueAttribute {
    std::string_view name;
    AttributeKind kind = AttributeKind::text;
    std::span<const std::byte> bytes;
};

/// Where the chunk table lies.
struct CatalogueTable {
    std::uint64_t offset = 0;
    std::uint64_t rows = 0;
    std::uint64_t rows_of_page = kRowsOfPage;
    std::uint64_t xxh64 = 0;          ///< of all rows
    std::span<const std::byte> sums;  ///< u64 each: XXH64 of the pages
};

/// Where the ranges of a level's cubes lie.
struct CatalogueRanges {
    int level = 0;
    std::uint64_t offset = 0;
    std::uint64_t bytes = 0;
    std::span<const std::byte> sums;  ///< u64 each: XXH64 of the planes
};

/// Where the names of labels lie.
struct CatalogueNames {
    std::uint64_t offset = 0;
    std::uint64_t rows = 0;
    std::uint64_t row_bytes = 0;
    std::uint64_t xxh64 = 0;
};

/// What the rows of an array's chunks say together.
struct ArrayTotals {
    std::uint64_t first_row = 0;  ///< of the chunk table
    std::uint64_t chunks = 0;
    std::uint64_t bytes = 0;  ///< stored
    double min = std::numeric_limits<double>::infinity();
    double max = -std::numeric_limits<double>::infinity();

    /// Of one more chunk.
    void add(const ChunkRow& row) {
        bytes += row.bytes;
        min = std::fmin(min, row.min);
        max = std::fmax(max, row.max);
    }
};
static_assert(sizeof(ArrayTotals) == 40);

/// A catalogue in parts, which are views of its bytes.
struct Catalogue {
    std::vector<CatalogueAttribute> attributes;
    std::optional<CatalogueTable> table;
    std::vector<CatalogueRanges> ranges;  ///< by rising levels
    std::optional<CatalogueNames> names;
    std::vector<ArrayTotals> totals;  ///< of the stored arrays, in the order of their rows

    [[nodiscard]] const CatalogueAttribute* find(std::string_view name) const;
    /// Of the array whose chunks have these rows.
    [[nodiscard]] const ArrayTotals* totals_of(std::uint64_t first_row, std::uint64_t chunks) const;
};

/// Nothing if these are not the bytes of one. Records that are not known are left out. What the
/// numbers in it mean for the file is not looked at.
std::optional<Catalogue> parse_catalogue(std::span<const std::byte> bytes);

/// The bytes of one. REQUIRES: names of attributes of at most 32 bytes.
std::vector<std::byte> catalogue_bytes(const Catalogue& catalogue);

}  // namespace isonest::detail
