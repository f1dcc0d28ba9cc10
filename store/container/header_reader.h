// The attributes of a store's root group: whether this version can read it, and what they say.
#pragma once

#include <array>
#include <cstdint>
#include <string>

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

/// `root`: HDF5's identifier of the root group; `file`: its name, for errors.
/// Throws Error{unsupported} for what a newer version may mean, and Error{corrupt}.
RootAttributes read_root_attributes(std::int64_t root, const std::string& file);
/// The same from a catalogue.
RootAttributes read_root_attributes(const Catalogue& catalogue, const std::string& file);

}  // namespace isonest::detail
