// Blocks of bytes that were packed as a whole, and whose unpacked size is known.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace isonest::detail {

enum class BlockPacking : std::uint8_t {
    zlib,  ///< RFC 1950
    lz4,   ///< one block without a frame
    lzma,  ///< .xz, or the older .lzma
    bzip2
};

/// The package of Debian that this build lacks to unpack such blocks; empty if it lacks none.
std::string missing_package(BlockPacking packing);

/// Bytes that unpack_block() may hold beside what it is given.
constexpr std::uint64_t most_beside(BlockPacking packing) {
    constexpr std::uint64_t kMiB = std::uint64_t{1} << 20U;
    return packing == BlockPacking::lzma    ? 80 * kMiB
           : packing == BlockPacking::bzip2 ? 4 * kMiB
                                            : 0;
}

/// Fills `out` exactly. False where the block is damaged or makes another number of bytes, or where
/// a package is missing. Thread-safe.
bool unpack_block(BlockPacking packing, std::span<const std::byte> packed,
                  std::span<std::byte> out);

}  // namespace isonest::detail
