// Contents and layout of a store, derived from its header alone. FORMAT.md is normative.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/curved_nodes.h>
#include <isonest/data_rounding.h>
#include <isonest/field.h>
#include <isonest/frame.h>
#include <isonest/int3.h>
#include <isonest/length_unit.h>
#include <isonest/value_type.h>
#include <isonest/volume_source.h>

#include "store/base/vectors.h"
#include "store/container/codec.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

// Bounds on the values within each cube of the coarser levels.
//
// Source: Gerstner, Rumpf, Weikard (2000), section 5: beta_0 excludes an element that the
// isosurface cannot reach. A bound on the distance from the element's linear function applies to
// both sides of it; if a few extremes lie far on one side, the range of the values themselves
// excludes more.

/// The finest level whose cubes have ranges: cubes of 8^3 finest cells.
inline constexpr int kFirstRangeLevel = 3;
inline constexpr std::int64_t kFirstRangeEdge = std::int64_t{1} << kFirstRangeLevel;

/// The smallest and largest value at the nodes of a closed cube, ignoring NaN; (+inf, -inf) if
/// there are none.
struct CubeRange {
    float low = std::numeric_limits<float>::infinity();
    float high = -std::numeric_limits<float>::infinity();

    bool operator==(const CubeRange&) const = default;
    /// Whether the cube may contain values below the isovalue and values not below it.
    [[nodiscard]] bool may_hold(double iso) const {
        return static_cast<double>(low) < iso && static_cast<double>(high) >= iso;
    }
    void include(const CubeRange& other) {
        low = other.low < low ? other.low : low;
        high = other.high > high ? other.high : high;
    }
};
static_assert(sizeof(CubeRange) == 8);

/// The narrowest range that contains both numbers.
inline CubeRange cube_range_around(double low, double high) {
    CubeRange range{static_cast<float>(low), static_cast<float>(high)};
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    if (static_cast<double>(range.low) > low) {
        range.low = std::nextafter(range.low, -kInfinity);
    }
    if (static_cast<double>(range.high) < high) {
        range.high = std::nextafter(range.high, kInfinity);
    }
    return range;
}

/// The type in which both numbers are stored: the type of the values if binary32 can represent all
/// of its numbers, else binary32, rounded outward.
inline ValueType cube_range_type(ValueType values) {
    return size_of(values) <= 2 ? values : ValueType::f32;
}
inline std::size_t cube_range_bytes(ValueType values) {
    return 2 * size_of(cube_range_type(values));
}

/// Whether the cubes of a level have ranges.
inline bool has_cube_ranges(const Lattice& lattice, int level) {
    return lattice.dimension() == 3 && level >= kFirstRangeLevel && level <= lattice.top();
}

inline constexpr std::uint32_t kFormatMajor = 2;
inline constexpr std::uint32_t kFormatMinor = 15;
/// The version of the format in which a store is written.
struct FormatVersion {
    std::uint64_t major = kFormatMajor;
    std::uint64_t minor = kFormatMinor;
    /// "2.3"
    [[nodiscard]] std::string text() const {
        return std::to_string(major) + "." + std::to_string(minor);
    }
    auto operator<=>(const FormatVersion&) const = default;
};
/// Bit of `flags`: the axes are not parallel to the world's axes; the attribute `direction` gives
/// them.
inline constexpr std::uint32_t kHasDirection = 1;
/// Bit of `flags`: the values represent labels of up to 62 bits (store/base/label_text.h).
inline constexpr std::uint32_t kHasLabels = 2;
/// Bit of `flags`: the axes in `direction` are not at right angles.
inline constexpr std::uint32_t kIsSheared = 4;
/// Bit of `flags`: some axes are uneven; the attributes `offsets_x`, `offsets_y` and `offsets_z`
/// say where their nodes lie.
inline constexpr std::uint32_t kIsUneven = 8;
/// Bit of `flags`: each node has a position of its own (`/positions`).
inline constexpr std::uint32_t kIsCurved = 16;
/// Bit of `flags`: some chunks are stored without the shuffle; their rows say so.
inline constexpr std::uint32_t kSkipsShuffle = 32;
/// Bit of `flags`: the values were rounded before they were stored; the attribute `tolerance` says
/// by how much.
inline constexpr std::uint32_t kIsRounded = 64;
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
    Directions direction = kAlongWorld;  ///< since version 2.5; sheared: 2.11
    UnevenAxesPtr uneven = {};           ///< not sheared as well; since version 2.14
    CurvedNodesPtr curved = {};          ///< neither with directions nor uneven; since version 2.15
    bool labels = false;                 ///< since version 2.6
    std::optional<LengthUnit> unit = {};               ///< unit of length; since version 2.7
    AnatomicalFrame frame = AnatomicalFrame::unknown;  ///< of the world axes; since version 2.10
    DataRounding rounding = {};                        ///< of all values; since version 2.13
    bool label_names = false;  ///< there is a table of label names; since version 2.8
    int chunk = 64;            ///< nodes per axis of a chunk of values: a power of two in 8..256
    int compression = 1;
    bool exact = false;         ///< indicators as binary32 instead of 16-bit codes
    bool cube_ranges = true;    ///< since version 2.2
    bool outward = true;        ///< since version 2.3: see StoreLayout::rounds_outward()
    std::vector<Field> fields;  ///< the indicators, in the order of precedes(); own: since 2.12
    /// Rows of the chunk table may say that a chunk is not shuffled; since version 2.13. False if
    /// all are shuffled: such a store has a lower version.
    bool skips_shuffle = true;
    /// Indicators of a newer minor version. They have rows in the chunk table, after those of
    /// `fields` on each level, and are not read.
    std::vector<std::string> unknown_fields = {};

    /// Whether the axes are not at right angles.
    [[nodiscard]] bool is_sheared() const { return !are_directions(direction); }
    /// Directions of the volume's own axes (store/base/vectors.h).
    [[nodiscard]] Directions rotation() const { return own_directions(direction); }
    /// Steps in own axes: node p lies at origin + steps().vector(p).
    /// They refer to `uneven`. For a curvilinear grid they are those of the lattice: 1.
    [[nodiscard]] LatticeSteps steps() const {
        return uneven ? LatticeSteps(spacing, uneven.get())
                      : LatticeSteps(spacing, direction, rotation());
    }
    /// The lowest version that supports everything in the header: stores that an older reader can
    /// open keep its version.
    [[nodiscard]] FormatVersion version() const {
        constexpr std::uint32_t kWithoutShear = 10;
        constexpr std::uint32_t kSheared = 11;
        constexpr std::uint32_t kWithOwn = 12;
        constexpr std::uint32_t kSkippingOrRounded = 13;
        constexpr std::uint32_t kUneven = 14;
        constexpr std::uint32_t kCurved = 15;
        const bool own = std::any_of(fields.begin(), fields.end(), is_own);
        return {kFormatMajor, curved                              ? kCurved
                              : uneven                            ? kUneven
                              : skips_shuffle || !rounding.none() ? kSkippingOrRounded
                              : own                               ? kWithOwn
                              : is_sheared()                      ? kSheared
                                                                  : kWithoutShear};
    }
};

/// One row of the chunk table, as stored (little endian, 40 bytes).
struct ChunkRow {
    std::uint64_t offset = 0;    ///< of the stored bytes, from the start of the file
    std::uint32_t bytes = 0;     ///< stored bytes
    std::uint32_t flags = 0;     ///< kChunkHasMissing and kChunkUnshuffled
    std::uint64_t checksum = 0;  ///< XXH64 of the stored bytes
    double min = 0;              ///< smallest finite value; for an indicator the smallest
    double max = 0;              ///< largest finite value; for an indicator the largest
};
static_assert(sizeof(ChunkRow) == 40);
/// Flags of a row: the chunk holds missing (non-finite) values; it is stored without the shuffle.
inline constexpr std::uint32_t kChunkHasMissing = 1;
inline constexpr std::uint32_t kChunkUnshuffled = 2;

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
    int coordinate = -1;         ///< the nodes' positions: 0, 1, 2 for x, y, z; -1: another array
    bool skips_shuffle = false;  ///< rows say which chunks are stored without the shuffle

    /// How this chunk is stored.
    [[nodiscard]] CodecSpec codec_of(const ChunkRow& row) const {
        CodecSpec stored = codec;
        stored.shuffle = codec.shuffle && !(skips_shuffle && (row.flags & kChunkUnshuffled) != 0);
        return stored;
    }
    /// HDF5's filter mask of the chunk: bit 0 stands for the first filter, the shuffle.
    [[nodiscard]] std::uint32_t filter_mask(const ChunkRow& row) const {
        return codec.shuffle && !codec_of(row).shuffle ? 1 : 0;
    }
    [[nodiscard]] std::size_t chunk_bytes() const {
        return static_cast<std::size_t>(chunk.product() * components) * codec.element_size;
    }
    [[nodiscard]] std::uint64_t row_of(const Int3& c) const {
        return first_row + static_cast<std::uint64_t>(grid.linear(c));
    }
    /// Maximum stored size of a chunk: one that zstd cannot shrink takes a little more than its
    /// decoded bytes. A larger size is an error.
    [[nodiscard]] std::size_t max_stored_bytes() const { return 2 * chunk_bytes() + 4096; }
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
    /// Throws Error{invalid_argument, unsupported} for an invalid header.
    explicit StoreLayout(const StoreHeader& header);

    [[nodiscard]] const StoreHeader& header() const { return header_; }
    [[nodiscard]] const Lattice& lattice() const { return lattice_; }
    /// The values and the indicators.
    [[nodiscard]] std::span<const ArrayInfo> arrays() const {
        return std::span(arrays_).first(arrays_.size() - positions_);
    }
    /// The nodes' coordinates x, y and z on level 0; empty unless the grid is curvilinear.
    [[nodiscard]] std::span<const ArrayInfo> positions() const {
        return std::span(arrays_).last(positions_);
    }
    /// arrays(), then positions(): all that have rows in the chunk table, in order.
    [[nodiscard]] std::span<const ArrayInfo> all_arrays() const { return arrays_; }
    [[nodiscard]] std::uint64_t rows() const { return rows_; }
    [[nodiscard]] bool has(Field field) const;
    /// Whether the store has ranges of the cubes of this level.
    [[nodiscard]] bool has_cube_ranges(int level) const {
        return header_.cube_ranges && isonest::detail::has_cube_ranges(lattice_, level);
    }
    /// Whether offsets of level 1 that are computed from the values are rounded outward
    /// (store/base/vectors.h), like the stored ones.
    [[nodiscard]] bool rounds_outward() const {
        return header_.outward && header_.type == ValueType::f64;
    }
    /// The tightest field for which is_bound() is true; nullopt if the store has none.
    [[nodiscard]] std::optional<Field> tightest_bound() const;
    /// Throws Error{not_found} listing the existing levels or fields.
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
    std::size_t positions_ = 0;  ///< number of arrays of positions
    std::uint64_t rows_ = 0;
};

/// Bytes of the largest decoded chunk of all arrays.
std::size_t largest_chunk_bytes(const StoreLayout& layout);

// The position of a volume in the world.

/// Limits of node distances, and of the absolute value of coordinates. Below kMinSpacing, the
/// 32-bit floats of meshes would become 0; above the maxima, squares of distances would not be
/// finite. (Meshes of volumes beyond the range of 32-bit floats are refused when they are
/// requested.)
inline constexpr double kMinSpacing = 1e-30;
inline constexpr double kMaxSpacing = 1e100;
inline constexpr double kMaxCoordinate = 1e110;

/// Empty if a volume can have this position; otherwise what is wrong and what is possible. It is
/// invalid if the first and last node of an axis have the same coordinate as 32-bit floats.
std::string why_no_place(const Int3& nodes, const Double3& spacing, const Double3& origin);

/// Why the axes cannot have these world directions; empty if they can. They must be right-handed
/// unit vectors that span space; an axis with one node must be at right angles to the others.
std::string why_no_directions(const Int3& nodes, const Directions& direction);

/// Why the nodes of these axes cannot lie there; empty if they can, and if all axes are even. An
/// uneven axis has 2 to kMaxUnevenNodes offsets, one for each node, that start with 0 and increase;
/// as 32-bit floats, the coordinates of neighbouring nodes differ. `spacing` is their mean step.
std::string why_not_uneven(const Int3& nodes, const Double3& spacing, const Double3& origin,
                           const Directions& direction, const UnevenAxesPtr& uneven);

/// Position of the last node in the volume's own axes. The rotation is about the first node, at the
/// header's origin.
inline Double3 last_position(const StoreHeader& header) {
    const Int3 cells = header.nodes - Int3{1, 1, 1};
    const Double3 way = header.steps().vector(
        {static_cast<double>(cells.x), static_cast<double>(cells.y), static_cast<double>(cells.z)});
    return {header.origin[0] + way[0], header.origin[1] + way[1], header.origin[2] + way[2]};
}

/// The type in which the positions of the nodes are stored; null unless there are any.
CurvedNodesPtr curved_of(const VolumeDescription& volume);

/// The header of a store of this volume, with its nodes and position.
inline StoreHeader header_of(const VolumeDescription& volume) {
    StoreHeader header;
    header.nodes = volume.nodes;
    header.type = volume.type;
    header.spacing = volume.spacing;
    header.origin = volume.origin;
    header.direction = volume.direction;
    header.uneven = volume.uneven;
    header.curved = curved_of(volume);
    header.labels = volume.labels;
    header.unit = volume.unit;
    header.frame = volume.frame;
    return header;
}

/// Length of the volume's longest diagonal in world units.
double diagonal_of(const StoreHeader& header);

/// "x and z meet at 71.5 degrees": describes the pair of axes that is farthest from a right angle.
/// `steps`: vectors along the axes, of any length. Axes with one node are ignored; empty if no
/// other axes meet at another angle than 90 degrees.
std::string sheared_axes(const Int3& nodes, const std::array<Double3, 3>& steps);

/// Throws Error{unsupported} unless the axes are at right angles. `what`: the operation that
/// requires it, "smoothing".
void require_right_angles(const Directions& direction, const std::string& name,
                          const std::string& what);

/// Throws Error{unsupported} unless all axes are even and the grid is not curvilinear.
void require_even_axes(const StoreHeader& header, const std::string& name, const std::string& what);
void require_even_axes(const VolumeDescription& volume, const std::string& what);
/// Throws Error{unsupported} for a curvilinear grid.
void require_not_curved(const StoreHeader& header, const std::string& name,
                        const std::string& what);
void require_not_curved(const VolumeDescription& volume, const std::string& what);

/// The largest coordinate of a node of a curvilinear grid: meshes have 32-bit floats.
inline constexpr double kMaxPosition = 1e37;

}  // namespace isonest::detail
