// What was done to the bytes of a Zarr chunk.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

namespace isonest::detail {

/// From bytes to bytes.
enum class ZarrCodec : std::uint8_t {
    zlib,
    gzip,
    zstd,
    blosc,
    crc32c  ///< a checksum of four bytes at the end
};

/// The codec of that name in version 2 ("id") or 3 ("name"). Throws Error{unsupported} for others,
/// and for those that this build does not have; `name` is used in messages.
ZarrCodec zarr_codec(const std::string& codec, const std::string& name);

/// Undoes the codecs, the last one first. `bytes`: how many come out of the first. Thread-safe.
/// Throws Error{corrupt}.
std::vector<std::byte> decode_zarr(std::vector<std::byte> packed, std::span<const ZarrCodec> codecs,
                                   std::uint64_t bytes, const std::string& name);

/// CRC-32C (Castagnoli), as RFC 3720 has it.
std::uint32_t crc32c(std::span<const std::byte> bytes);

}  // namespace isonest::detail
