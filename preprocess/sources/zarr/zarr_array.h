// The description of a Zarr array, of version 2 or 3.
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include <isonest/value_type.h>

#include "preprocess/sources/wrapping/scaled_source.h"
#include "preprocess/sources/zarr/zarr_codec.h"
#include "preprocess/sources/zarr/zarr_files.h"

namespace isonest::detail {

using Lengths = std::vector<std::uint64_t>;  ///< per axis, slowest first

/// How the numbers of a chunk are arranged, and how their bytes were encoded.
struct ZarrChunk {
    Lengths shape;
    std::vector<std::size_t> order;  ///< the axes as stored, slowest first
    bool big_endian = false;
    std::vector<ZarrCodec> codecs;
};

struct ZarrArray {
    std::filesystem::path folder;
    std::filesystem::path description;  ///< the file that contains the description
    Lengths shape;
    ValueType type = ValueType::u8;
    std::optional<StoredNumber> stored;  ///< instead of the type
    /// One value, in native endianness; the contents of chunks without a file.
    std::vector<std::byte> fill;
    bool has_fill = false;  ///< the description gives one
    double fill_number = 0;
    ZarrChunk chunk;
    /// A file of the array is a shard, with several chunks and an index.
    struct Shard {
        Lengths shape;
        std::vector<ZarrCodec> index_codecs;
        bool index_at_end = true;
    };
    std::optional<Shard> shard;
    std::string prefix;  ///< of the file names: "" or "c" with the separator
    char separator = '.';
    std::vector<std::string> names;  ///< of the axes; empty if not given
    nlohmann::json attributes;

    [[nodiscard]] std::size_t value_bytes() const {
        return size_of(stored ? bits_type(*stored) : type);
    }
    /// The file of a chunk or shard.
    [[nodiscard]] std::filesystem::path file_of(const Lengths& index) const;
};

/// Whether a folder holds an array, or a group.
bool is_zarr_array(ZarrFiles& files, const std::filesystem::path& folder);
bool is_zarr_group(ZarrFiles& files, const std::filesystem::path& folder);
/// The file that describes an array: zarr.json or, if there is none, .zarray.
std::filesystem::path description_of(ZarrFiles& files, const std::filesystem::path& folder);
/// A group's attributes. Throws Error{corrupt, io}.
nlohmann::json zarr_group_attributes(ZarrFiles& files, const std::filesystem::path& folder);

/// Throws Error{corrupt, unsupported, io}. Every length is checked before it is used; there are at
/// most 32 axes, and a chunk has at most 2^40 bytes.
ZarrArray read_zarr_array(ZarrFiles& files, const std::filesystem::path& folder);

}  // namespace isonest::detail
