// Sources: https://zarr-specs.readthedocs.io/en/latest/v3/codecs/index.html;
// https://numcodecs.readthedocs.io (version 2).
#include "preprocess/sources/zarr/zarr_codec.h"

#if ISONEST_WITH_BLOSC
#include <blosc.h>
#endif
#include <fmt/format.h>
#include <zlib.h>
#include <zstd.h>

#include <array>
#include <cstring>
#include <optional>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

constexpr std::size_t kChecksum = 4;

[[noreturn]] void corrupt(const std::string& name, const std::string& what) {
    throw Error(ErrorKind::corrupt, {name}, what);
}

/// `bytes` exactly.
std::vector<std::byte> inflated(std::span<const std::byte> packed, std::uint64_t bytes,
                                const std::string& name) {
    std::vector<std::byte> out(bytes);
    z_stream stream{};
    constexpr int kZlibOrGzip = 32;
    if (::inflateInit2(&stream, MAX_WBITS + kZlibOrGzip) != Z_OK) {
        throw std::bad_alloc();
    }
    constexpr std::uint64_t kPart = std::uint64_t{1} << 30U;
    int code = Z_OK;
    std::uint64_t in = 0;
    std::uint64_t done = 0;
    while (code == Z_OK || code == Z_BUF_ERROR) {
        stream.next_in = reinterpret_cast<Bytef*>(const_cast<std::byte*>(packed.data() + in));
        stream.avail_in = static_cast<uInt>(std::min<std::uint64_t>(kPart, packed.size() - in));
        stream.next_out = reinterpret_cast<Bytef*>(out.data() + done);
        stream.avail_out = static_cast<uInt>(std::min<std::uint64_t>(kPart, bytes - done));
        const uInt had = stream.avail_in;
        const uInt free = stream.avail_out;
        code = ::inflate(&stream, Z_NO_FLUSH);
        in += had - stream.avail_in;
        done += free - stream.avail_out;
        if (had == stream.avail_in && free == stream.avail_out) {
            break;  // nothing more to be had
        }
    }
    ::inflateEnd(&stream);
    if (code != Z_STREAM_END || done != bytes) {
        corrupt(name, fmt::format("it does not unpack to {} bytes", bytes));
    }
    return out;
}

std::vector<std::byte> from_zstd(std::span<const std::byte> packed, std::uint64_t bytes,
                                 const std::string& name) {
    std::vector<std::byte> out(bytes);
    const std::size_t made = ::ZSTD_decompress(out.data(), bytes, packed.data(), packed.size());
    if (::ZSTD_isError(made) != 0 || made != bytes) {
        corrupt(name, fmt::format("it does not unpack to {} bytes{}{}", bytes,
                                  ::ZSTD_isError(made) != 0 ? ": " : "",
                                  ::ZSTD_isError(made) != 0 ? ::ZSTD_getErrorName(made) : ""));
    }
    return out;
}

std::vector<std::byte> from_blosc(std::span<const std::byte> packed, std::uint64_t bytes,
                                  const std::string& name) {
#if ISONEST_WITH_BLOSC
    std::vector<std::byte> out(bytes);
    std::size_t made = 0;
    constexpr int kOneThread = 1;
    if (packed.size() < BLOSC_MIN_HEADER_LENGTH ||
        ::blosc_cbuffer_validate(packed.data(), packed.size(), &made) < 0 || made != bytes ||
        ::blosc_decompress_ctx(packed.data(), out.data(), bytes, kOneThread) !=
            static_cast<int>(bytes)) {
        corrupt(name, fmt::format("blosc does not unpack it to {} bytes", bytes));
    }
    return out;
#else
    static_cast<void>(packed);
    static_cast<void>(bytes);
    corrupt(name, "this build has no blosc");
#endif
}

/// How many bytes the codec takes; it makes `bytes` of them.
std::vector<std::byte> undo(ZarrCodec codec, std::vector<std::byte> packed, std::uint64_t bytes,
                            const std::string& name) {
    switch (codec) {
        case ZarrCodec::zlib:
        case ZarrCodec::gzip:
            return inflated(packed, bytes, name);
        case ZarrCodec::zstd:
            return from_zstd(packed, bytes, name);
        case ZarrCodec::blosc:
            return from_blosc(packed, bytes, name);
        case ZarrCodec::crc32c:
            break;
    }
    if (packed.size() != bytes + kChecksum) {
        corrupt(name,
                fmt::format("{} bytes, but {} and a checksum are right", packed.size(), bytes));
    }
    std::uint32_t stored = 0;
    std::memcpy(&stored, packed.data() + bytes, kChecksum);
    packed.resize(bytes);
    if (crc32c(packed) != stored) {
        corrupt(name, "the checksum is wrong");
    }
    return packed;
}

}  // namespace

ZarrCodec zarr_codec(const std::string& codec, const std::string& name) {
    if (codec == "zlib") {
        return ZarrCodec::zlib;
    }
    if (codec == "gzip") {
        return ZarrCodec::gzip;
    }
    if (codec == "zstd") {
        return ZarrCodec::zstd;
    }
    if (codec == "crc32c") {
        return ZarrCodec::crc32c;
    }
    if (codec == "blosc") {
#if ISONEST_WITH_BLOSC
        return ZarrCodec::blosc;
#else
        throw Error(ErrorKind::unsupported, {name},
                    "its chunks went through blosc, which this build does not have",
                    {{RemedyKind::install_package, "libblosc-dev"}});
#endif
    }
    throw Error(ErrorKind::unsupported, {name},
                fmt::format("its chunks went through the codec '{:.40}': zlib, gzip, zstd, blosc "
                            "and crc32c are read",
                            codec));
}

std::vector<std::byte> decode_zarr(std::vector<std::byte> packed, std::span<const ZarrCodec> codecs,
                                   std::uint64_t bytes, const std::string& name) {
    // What goes into a codec has four bytes more for each checksum before it. What comes out of a
    // compressor is not known; there is one at most.
    std::vector<std::optional<std::uint64_t>> sizes;
    std::optional<std::uint64_t> made = bytes;
    for (const ZarrCodec codec : codecs) {
        sizes.push_back(made);
        if (codec != ZarrCodec::crc32c) {
            made.reset();
        } else if (made) {
            *made += kChecksum;
        }
    }
    for (std::size_t i = codecs.size(); i-- > 0;) {
        if (!sizes[i] && codecs[i] != ZarrCodec::crc32c) {
            throw Error(ErrorKind::unsupported, {name}, "its chunks were compressed twice");
        }
        const std::uint64_t without =
            packed.size() - std::min<std::size_t>(packed.size(), kChecksum);
        packed = undo(codecs[i], std::move(packed), sizes[i].value_or(without), name);
    }
    if (packed.size() != bytes) {
        corrupt(name, fmt::format("{} bytes, but {} are right", packed.size(), bytes));
    }
    return packed;
}

std::uint32_t crc32c(std::span<const std::byte> bytes) {
    static const std::array<std::uint32_t, 256> table = [] {
        constexpr std::uint32_t kPolynomial = 0x82F63B78U;
        std::array<std::uint32_t, 256> t{};
        for (std::uint32_t i = 0; i < t.size(); ++i) {
            std::uint32_t c = i;
            for (int k = 0; k < 8; ++k) {
                c = (c & 1U) != 0 ? c >> 1U ^ kPolynomial : c >> 1U;
            }
            t.at(i) = c;
        }
        return t;
    }();
    std::uint32_t c = ~std::uint32_t{0};
    for (const std::byte b : bytes) {
        c = table.at((c ^ std::to_integer<std::uint32_t>(b)) & 0xFFU) ^ c >> 8U;
    }
    return ~c;
}

}  // namespace isonest::detail
