// The codecs of Zarr chunks.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

namespace isonest::detail {

/// The type of numbers between two codecs.
struct ZarrNumber {
    char kind = 'u';  ///< 'i', 'u' or 'f'
    std::size_t bytes = 1;
    bool big_endian = false;
};

/// A codec from bytes to bytes, in versions 2 (compressor and filters) and 3.
struct ZarrCodec {
    enum class Kind : std::uint8_t {
        zlib,
        gzip,
        zstd,
        blosc,
        lz4,  ///< the uncompressed size in four bytes, then one block
        bzip2,
        lzma,
        crc32c,   ///< a four-byte checksum at the end
        crc32,    ///< a four-byte checksum at the start
        adler32,  ///< the same
        shuffle,  ///< bytes of the numbers, sorted by their position in the number
        delta,    ///< differences
        scaled,   ///< (number - offset) * scale, rounded
        same      ///< nothing to undo: bits were rounded off before
    };
    Kind kind = Kind::same;
    std::size_t element = 1;  ///< shuffle: bytes of a number
    ZarrNumber made = {};     ///< delta, scaled: type of the decoded numbers
    ZarrNumber stored = {};   ///< and of the encoded numbers
    double scale = 1;
    double offset = 0;
};

/// The codec with that name in version 2 ("id") or 3 ("name"), with its configuration. Throws
/// Error{unsupported} for others, and for those that this build does not have; `name` is used in
/// messages.
ZarrCodec zarr_codec(const std::string& codec, const nlohmann::json& options,
                     const std::string& name);
/// Whether it works on numbers; in version 3 it then precedes the codec "bytes".
bool is_of_numbers(const std::string& codec);

/// Decodes, last codec first. `bytes`: size before the first codec was applied. Thread-safe. Throws
/// Error{corrupt}.
std::vector<std::byte> decode_zarr(std::vector<std::byte> packed, std::span<const ZarrCodec> codecs,
                                   std::uint64_t bytes, const std::string& name);

/// The maximum number of bytes between two codecs, as far as it is known before a chunk is read.
std::uint64_t max_between(std::span<const ZarrCodec> codecs, std::uint64_t bytes);

/// Bytes that the libraries may allocate while one chunk is decoded. `bytes`: from max_between().
std::uint64_t beside_codecs(std::span<const ZarrCodec> codecs, std::uint64_t bytes);

/// CRC-32C (Castagnoli), as in RFC 3720.
std::uint32_t crc32c(std::span<const std::byte> bytes);

}  // namespace isonest::detail
