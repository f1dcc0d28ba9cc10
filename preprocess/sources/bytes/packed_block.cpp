// Sources: https://zlib.net/manual.html, https://github.com/lz4/lz4/blob/dev/lib/lz4.h,
// https://tukaani.org/xz/liblzma-api/, https://sourceware.org/bzip2/manual/manual.html
#include "preprocess/sources/bytes/packed_block.h"

#if ISONEST_WITH_BZIP2
#include <bzlib.h>
#endif
#if ISONEST_WITH_LZ4
#include <lz4.h>
#endif
#if ISONEST_WITH_LZMA
#include <lzma.h>
#endif
#include <zlib.h>

#include <limits>

namespace isonest::detail {
namespace {

using Packed = std::span<const std::byte>;
using Unpacked = std::span<std::byte>;

bool unpack_zlib(Packed packed, Unpacked out) {
    uLongf made = out.size();
    return ::uncompress(reinterpret_cast<Bytef*>(out.data()), &made,
                        reinterpret_cast<const Bytef*>(packed.data()), packed.size()) == Z_OK &&
           made == out.size();
}

#if ISONEST_WITH_LZ4
bool unpack_lz4(Packed packed, Unpacked out) {
    constexpr std::size_t kMost = std::numeric_limits<int>::max();
    return packed.size() <= kMost && out.size() <= kMost &&
           ::LZ4_decompress_safe(reinterpret_cast<const char*>(packed.data()),
                                 reinterpret_cast<char*>(out.data()),
                                 static_cast<int>(packed.size()),
                                 static_cast<int>(out.size())) == static_cast<int>(out.size());
}
#endif

#if ISONEST_WITH_LZMA
bool unpack_lzma(Packed packed, Unpacked out) {
    lzma_stream stream = LZMA_STREAM_INIT;
    if (::lzma_auto_decoder(&stream, most_beside(BlockPacking::lzma), 0) != LZMA_OK) {
        return false;
    }
    stream.next_in = reinterpret_cast<const std::uint8_t*>(packed.data());
    stream.avail_in = packed.size();
    stream.next_out = reinterpret_cast<std::uint8_t*>(out.data());
    stream.avail_out = out.size();
    lzma_ret code = ::lzma_code(&stream, LZMA_RUN);
    if (code == LZMA_OK) {
        code = ::lzma_code(&stream, LZMA_FINISH);
    }
    const bool is_whole = code == LZMA_STREAM_END && stream.avail_out == 0;
    ::lzma_end(&stream);
    return is_whole;
}
#endif

#if ISONEST_WITH_BZIP2
bool unpack_bzip2(Packed packed, Unpacked out) {
    constexpr std::size_t kMost = std::numeric_limits<unsigned>::max();
    if (packed.size() > kMost || out.size() > kMost) {
        return false;
    }
    auto made = static_cast<unsigned>(out.size());
    constexpr int kNotSmall = 0;
    constexpr int kQuiet = 0;
    return ::BZ2_bzBuffToBuffDecompress(
               reinterpret_cast<char*>(out.data()), &made,
               const_cast<char*>(reinterpret_cast<const char*>(packed.data())),
               static_cast<unsigned>(packed.size()), kNotSmall, kQuiet) == BZ_OK &&
           made == out.size();
}
#endif

}  // namespace

std::string missing_package(BlockPacking packing) {
#if !ISONEST_WITH_LZ4
    if (packing == BlockPacking::lz4) {
        return "liblz4-dev";
    }
#endif
#if !ISONEST_WITH_LZMA
    if (packing == BlockPacking::lzma) {
        return "liblzma-dev";
    }
#endif
#if !ISONEST_WITH_BZIP2
    if (packing == BlockPacking::bzip2) {
        return "libbz2-dev";
    }
#endif
    static_cast<void>(packing);
    return "";
}

bool unpack_block(BlockPacking packing, Packed packed, Unpacked out) {
    switch (packing) {
        case BlockPacking::zlib:
            return unpack_zlib(packed, out);
#if ISONEST_WITH_LZ4
        case BlockPacking::lz4:
            return unpack_lz4(packed, out);
#endif
#if ISONEST_WITH_LZMA
        case BlockPacking::lzma:
            return unpack_lzma(packed, out);
#endif
#if ISONEST_WITH_BZIP2
        case BlockPacking::bzip2:
            return unpack_bzip2(packed, out);
#endif
        default:
            return false;
    }
}

}  // namespace isonest::detail
