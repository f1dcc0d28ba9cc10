// What was done to the bytes of a Zarr chunk.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

namespace isonest::detail {

/// A type of numbers between two codecs.
struct ZarrNumber {
    char kind = 'u';  ///< 'i', 'u' or 'f'
    std::size_t bytes = 1;
    bool big_endian = false;
};

/// From bytes to bytes, in versions 2 (compressor and filters) and 3.
struct ZarrCodec {
    enum class Kind : std::uint8_t {
        zlib,
        gzip,
        zstd,
        blosc,
        lz4,  ///< four bytes of the unpacked size, and a block
        bzip2,
        lzma,
        crc32c,   ///< a checksum of four bytes at the end
        crc32,    ///< one of four bytes at the start
        adler32,  ///< the same
        shuffle,  ///< the bytes of the numbers sorted by their place in a number
        delta,    ///< differences
        scaled,   ///< (number - offset) * scale, rounded
        same      ///< nothing to undo: bits were rounded off before
    };
    Kind kind = Kind::same;
    std::size_t element = 1;  ///< shuffle: bytes of a number
    ZarrNumber made = {};     ///< delta, scaled: the numbers that undoing it makes
    ZarrNumber stored = {};   ///< and those that it makes them of
    double scale = 1;
    double offset = 0;
};

/// The codec of that name in version 2 ("id") or 3 ("name"), with its configuration. Throws
/// Error{unsupported} for others, and for those that this build does not have; `name` is used in
/// messages.
ZarrCodec zarr_codec(const std::string& codec, const nlohmann::json& options,
                     const std::string& name);
/// Whether it works on numbers, so that version 3 has it before the codec "bytes".
bool is_of_numbers(const std::string& codec);

/// Undoes the codecs, the last one first. `bytes`: how many come out of the first. Thread-safe.
/// Throws Error{corrupt}.
std::vector<std::byte> decode_zarr(std::vector<std::byte> packed, std::span<const ZarrCodec> codecs,
                                   std::uint64_t bytes, const std::string& name);

/// The most bytes between two codecs, as far as their number is known before a chunk is read.
std::uint64_t most_between(std::span<const ZarrCodec> codecs, std::uint64_t bytes);

/// Bytes that the libraries may hold while one chunk is decoded.
std::uint64_t beside_codecs(std::span<const ZarrCodec> codecs);

/// CRC-32C (Castagnoli), as RFC 3720 has it.
std::uint32_t crc32c(std::span<const std::byte> bytes);

}  // namespace isonest::detail
