// Reads the attributes of a store's root group, and checks whether this version can read the store.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "store/container/format.h"
#include "store/container/parts/footer.h"

namespace isonest::detail {

// Checksums of parts of a store's header: FORMAT.md, section 2.

/// The attributes that the header's `xxh64` covers, in this order.
inline constexpr std::array<const char*, 12> kDigested{
    "version", "flags",       "nodes", "spacing", "origin", "value_type",
    "chunk",   "compression", "exact", "fields",  "range",  "has_missing"};

/// The nine numbers of the three vectors, one vector after the other.
std::vector<double> flat_directions(const Directions& direction);

/// XXH64 of the nine numbers in the order of the attribute `direction`.
std::uint64_t direction_digest(const Directions& direction);

/// Attributes of the offsets along x, y and z.
inline constexpr std::array<const char*, 3> kOffsets{"offsets_x", "offsets_y", "offsets_z"};

/// XXH64 of the offsets along x, y and z as stored, one axis after the other.
std::uint64_t offsets_digest(const UnevenAxes& axes);

/// The attributes `position_numbers` and `position_folds`, and XXH64 of both and `position_type` as
/// stored.
std::vector<double> position_numbers(const CurvedNodes& nodes);
std::vector<std::uint64_t> position_folds(const CurvedNodes& nodes);
std::uint64_t positions_digest(const CurvedNodes& nodes);

/// The two numbers of the attribute `tolerance`.
std::vector<double> rounding_numbers(const DataRounding& rounding);

/// XXH64 of an attribute of numbers as stored.
std::uint64_t numbers_digest(const std::vector<double>& numbers);

/// XXH64 of a text attribute (`unit`, `frame`) as stored.
std::uint64_t text_digest(std::string_view text);

/// The contents of the root group (FORMAT.md, section 2).
struct RootAttributes {
    FormatVersion version;
    StoreHeader header;
    std::array<double, 2> range{};  ///< smallest and largest finite value of level 0
    std::uint64_t has_missing = 0;
};

/// The attributes of a root group, from any source. Nullopt if one is missing or has another type.
class RootGroup {
  public:
    RootGroup() = default;
    RootGroup(const RootGroup&) = delete;
    RootGroup& operator=(const RootGroup&) = delete;
    virtual ~RootGroup() = default;
    [[nodiscard]] virtual std::optional<std::string> text(const char* name) const = 0;
    [[nodiscard]] virtual std::optional<std::vector<std::uint64_t>> integers(
        const char* name, std::size_t count) const = 0;
    [[nodiscard]] virtual std::optional<std::vector<double>> numbers(const char* name,
                                                                     std::size_t count) const = 0;
    /// Digest of the attributes in kDigested.
    [[nodiscard]] virtual std::optional<std::uint64_t> digest() const = 0;
    [[nodiscard]] virtual bool has_label_names() const = 0;
};

/// `root`: HDF5 identifier of the root group; `file`: its name, for errors. Throws
/// Error{unsupported} for what only a newer version may understand, and Error{corrupt}.
RootAttributes read_root_attributes(std::int64_t root, const std::string& file);
/// The same from a catalogue, or from any other source of attributes.
RootAttributes read_root_attributes(const Catalogue& catalogue, const std::string& file);
RootAttributes read_root_attributes(const RootGroup& root, const std::string& file);

}  // namespace isonest::detail
