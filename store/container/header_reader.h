// The attributes of a store's root group: whether this version can read it, and what they say.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "store/container/footer/catalogue.h"
#include "store/container/format.h"

namespace isonest::detail {

/// What the root group says (FORMAT.md, section 2).
struct RootAttributes {
    FormatVersion version;
    StoreHeader header;
    std::array<double, 2> range{};  ///< smallest and largest finite value of level 0
    std::uint64_t has_missing = 0;
};

/// Attributes of a root group, wherever they are. Empty where one is missing or another kind.
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
    /// Of those in kDigested.
    [[nodiscard]] virtual std::optional<std::uint64_t> digest() const = 0;
    [[nodiscard]] virtual bool has_label_names() const = 0;
};

/// `root`: HDF5's identifier of the root group; `file`: its name, for errors.
/// Throws Error{unsupported} for what a newer version may mean, and Error{corrupt}.
RootAttributes read_root_attributes(std::int64_t root, const std::string& file);
/// The same from a catalogue, or anything else that has them.
RootAttributes read_root_attributes(const Catalogue& catalogue, const std::string& file);
RootAttributes read_root_attributes(const RootGroup& root, const std::string& file);

}  // namespace isonest::detail
