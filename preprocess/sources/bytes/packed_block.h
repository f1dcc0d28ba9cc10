// Blocks of bytes that were compressed as a whole, with known uncompressed size.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace isonest::detail {

enum class BlockPacking : std::uint8_t {
    zlib,  ///< RFC 1950
    lz4,   ///< one block without a frame
    lzma,  ///< .xz, or the older .lzma
    bzip2
};

/// The Debian package that this build would need to decompress such blocks; empty if it can.
std::string missing_package(BlockPacking packing);

/// Bytes that unpack_block() may allocate in addition to its arguments, for a block of `bytes`
/// uncompressed. For LZMA, this is a dictionary, limited to the size of the block whatever its
/// header says.
constexpr std::uint64_t max_beside(BlockPacking packing, std::uint64_t bytes) {
    constexpr std::uint64_t kLzmaDecoder = std::uint64_t{128} << 10U;
    constexpr std::uint64_t kBzip2Decoder = std::uint64_t{4} << 20U;
    return packing == BlockPacking::lzma    ? kLzmaDecoder + bytes
           : packing == BlockPacking::bzip2 ? kBzip2Decoder
                                            : 0;
}

/// Fills `out` exactly. Returns false if the block is damaged or has another size, or if the
/// library for it is missing. Thread-safe.
bool unpack_block(BlockPacking packing, std::span<const std::byte> packed,
                  std::span<std::byte> out);

// The contents of a ZIP archive, and where they are.

struct ZipMember {
    std::string name;
    bool deflated = false;     ///< otherwise stored without compression
    std::uint64_t start = 0;   ///< offset of its data in the archive
    std::uint64_t packed = 0;  ///< bytes in the archive
    std::uint64_t bytes = 0;   ///< uncompressed
    std::uint32_t crc = 0;     ///< CRC-32 of the uncompressed data
    bool readable = true;      ///< not encrypted, and compressed by a known method
};

/// Reads the archive's central directory, also that of ZIP64.
/// Source: https://pkware.cachefly.net/webdocs/casestudies/APPNOTE.TXT
/// Throws Error{corrupt, unsupported, io}; refuses more than 250,000 members.
std::vector<ZipMember> read_zip_directory(const std::filesystem::path& path);

}  // namespace isonest::detail
