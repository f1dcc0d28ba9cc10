// What a store contains and where, derived from its header alone. FORMAT.md is the normative text.
#pragma once

#include <compare>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <isonest/field.h>
#include <isonest/frame.h>
#include <isonest/int3.h>
#include <isonest/length_unit.h>
#include <isonest/value_type.h>

#include "store/container/codec.h"
#include "store/container/cube_range.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

inline constexpr std::uint32_t kFormatMajor = 2;
inline constexpr std::uint32_t kFormatMinor = 10;
/// Of the format in which a store is written.
struct FormatVersion {
    std::uint64_t major = kFormatMajor;
    std::uint64_t minor = kFormatMinor;
    /// "2.3"
    [[nodiscard]] std::string text() const {
        return std::to_string(major) + "." + std::to_string(minor);
    }
    auto operator<=>(const FormatVersion&) const = default;
};
/// Bit of `flags`: the axes are not along the world's, the attribute `direction` says how.
inline constexpr std::uint32_t kHasDirection = 1;
/// Bit of `flags`: the values stand for labels of up to 62 bits (store/base/label_bits.h).
inline constexpr std::uint32_t kHasLabels = 2;
inline constexpr const char* kFormatName = "isonest";
inline constexpr unsigned kZstdFilter = 32015;
inline constexpr int kMinChunk = 8;
inline constexpr int kMaxChunk = 256;

/// Everything that determines a store's layout and its meaning.
struct StoreHeader {
    Int3 nodes{1, 1, 1};
    ValueType type = ValueType::f32;
    Double3 spacing{1, 1, 1};
    Double3 origin{0, 0, 0};
    Directions direction = kAlongWorld;                ///< since version 2.5
    bool labels = false;                               ///< since version 2.6
    std::optional<LengthUnit> unit = {};               ///< of length; since version 2.7
    AnatomicalFrame frame = AnatomicalFrame::unknown;  ///< of the world; since version 2.10
    bool label_names = false;  ///< there is a table of names of labels; since version 2.8
    int chunk = 64;            ///< nodes per axis of a chunk of values: a power of two in 8..256
    int compression = 1;
    bool exact = false;         ///< indicators as binary32 instead of 16-bit codes
    bool cube_ranges = true;    ///< since version 2.2
    bool outward = true;        ///< since version 2.3: see StoreLayout::rounds_outward()
    std::vector<Field> fields;  ///< the indicators, in the order of the enumeration
    /// Indicators of a newer minor version: they have rows in the chunk table, behind those of
    /// `fields` on each level, and are not read.
    std::vector<std::string> unknown_fields = {};
};

/// One row of the chunk table, as stored (little endian, 40 bytes).
struct ChunkRow {
    std::uint64_t offset = 0;    ///< of the stored bytes, from the start of the file
    std::uint32_t bytes = 0;     ///< stored bytes
    std::uint32_t flags = 0;     ///< bit 0: the chunk holds missing (non-finite) values; rest 0
    std::uint64_t checksum = 0;  ///< XXH64 of the stored bytes
    double min = 0;              ///< smallest finite value; for an indicator the smallest
    double max = 0;              ///< largest finite value; for an indicator the largest
};
static_assert(sizeof(ChunkRow) == 40);
inline constexpr std::uint32_t kChunkHasMissing = 1;

/// One stored array: a field of a level.
struct ArrayInfo {
    int level = 0;
    Field field = Field::values;
    Int3 nodes;                   ///< lattice nodes of the level
    Int3 chunk;                   ///< nodes per chunk
    Int3 grid;                    ///< chunks per axis
    int components = 1;           ///< 1 for values; indicators: slots from first_slot on
    int first_slot = 0;           ///< indicators: the slot of component 0
    std::uint64_t first_row = 0;  ///< of the chunk table; chunks follow x fastest
    bool alias = false;           ///< the same stored array as another field's (a hard link)
    CodecSpec codec;

    [[nodiscard]] std::size_t chunk_bytes() const {
        return static_cast<std::size_t>(chunk.product() * components) * codec.element_size;
    }
    [[nodiscard]] std::uint64_t row_of(const Int3& c) const {
        return first_row + static_cast<std::uint64_t>(grid.linear(c));
    }
    /// A chunk that zstd cannot shrink takes a little more than its bytes; what takes more than
    /// this is none.
    [[nodiscard]] std::size_t most_stored_bytes() const { return 2 * chunk_bytes() + 4096; }
    [[nodiscard]] bool has_chunk(const Int3& c) const {
        return min(c, {0, 0, 0}) == Int3{0, 0, 0} && max(c + Int3{1, 1, 1}, grid) == grid;
    }
    /// The first lattice node of chunk c.
    [[nodiscard]] Int3 first_node(const Int3& c) const {
        return {c.x * chunk.x, c.y * chunk.y, c.z * chunk.z};
    }
    /// The chunk that holds lattice node p. REQUIRES: p >= 0.
    [[nodiscard]] Int3 chunk_of(const Int3& p) const {
        return {p.x / chunk.x, p.y / chunk.y, p.z / chunk.z};
    }
    /// "level 2, deviation_bar, chunk 3 0 1": for messages.
    [[nodiscard]] std::string place(const Int3& c) const;
};

/// All arrays of a store.
class StoreLayout {
  public:
    StoreLayout() = default;
    /// Throws Error{invalid_argument, unsupported} for a header that makes no sense.
    explicit StoreLayout(const StoreHeader& header);

    [[nodiscard]] const StoreHeader& header() const { return header_; }
    [[nodiscard]] const Lattice& lattice() const { return lattice_; }
    [[nodiscard]] const std::vector<ArrayInfo>& arrays() const { return arrays_; }
    [[nodiscard]] std::uint64_t rows() const { return rows_; }
    [[nodiscard]] bool has(Field field) const;
    /// Whether the cubes of this level have ranges in the store.
    [[nodiscard]] bool has_cube_ranges(int level) const {
        return header_.cube_ranges && isonest::detail::has_cube_ranges(lattice_, level);
    }
    /// Whether the offsets of level 1 are rounded outward (store/base/outward.h) where the values
    /// say them, as those that are stored.
    [[nodiscard]] bool rounds_outward() const {
        return header_.outward && header_.type == ValueType::f64;
    }
    /// The tightest field that is_bound(); none if the store has no such field.
    [[nodiscard]] std::optional<Field> tightest_bound() const;
    /// Throws Error{not_found} listing the fields there are.
    [[nodiscard]] const ArrayInfo& array(int level, Field field) const;
    /// The HDF5 path, "/levels/2/linf_bar".
    [[nodiscard]] static std::string path_of(const ArrayInfo& array);
    /// "/levels/3/cube_ranges", and the checksums of its planes.
    [[nodiscard]] static std::string cube_ranges_path(int level);
    [[nodiscard]] static std::string cube_range_sums_path(int level);

  private:
    StoreHeader header_;
    Lattice lattice_;
    std::vector<ArrayInfo> arrays_;
    std::uint64_t rows_ = 0;
};

/// Bytes of the largest decoded chunk of all arrays.
std::size_t largest_chunk_bytes(const StoreLayout& layout);

}  // namespace isonest::detail
