// Sources: https://zarr-specs.readthedocs.io/en/latest/v3/codecs/index.html;
// https://numcodecs.readthedocs.io (version 2).
#include "preprocess/sources/zarr/zarr_codec.h"

#if ISONEST_WITH_BLOSC
#include <blosc.h>
#endif
#include <fmt/format.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <optional>
#include <string_view>

#include <isonest/error.h>

#include "preprocess/sources/bytes/packed_block.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kChecksum = 4;

[[noreturn]] void corrupt(const std::string& name, const std::string& what) {
    throw Error(ErrorKind::corrupt, {name}, what);
}

/// Decompresses to exactly `bytes` bytes.
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
            break;  // no more output
        }
    }
    ::inflateEnd(&stream);
    if (code != Z_STREAM_END || done != bytes) {
        corrupt(name, fmt::format("the data do not decompress to {} bytes", bytes));
    }
    return out;
}

std::vector<std::byte> from_zstd(std::span<const std::byte> packed, std::uint64_t bytes,
                                 const std::string& name) {
    std::vector<std::byte> out(bytes);
    const std::size_t made = ::ZSTD_decompress(out.data(), bytes, packed.data(), packed.size());
    if (::ZSTD_isError(made) != 0 || made != bytes) {
        corrupt(name, fmt::format("the data do not decompress to {} bytes{}{}", bytes,
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
        corrupt(name, fmt::format("blosc does not decompress the data to {} bytes", bytes));
    }
    return out;
#else
    static_cast<void>(packed);
    static_cast<void>(bytes);
    corrupt(name, "this build does not support blosc");
#endif
}

std::vector<std::byte> from_block(BlockPacking packing, std::span<const std::byte> packed,
                                  std::uint64_t bytes, const std::string& name) {
    std::vector<std::byte> out(bytes);
    if (!unpack_block(packing, packed, out)) {
        corrupt(name, fmt::format("the data do not decompress to {} bytes", bytes));
    }
    return out;
}

/// As numcodecs writes it: the uncompressed size, then the block.
std::vector<std::byte> from_lz4(std::span<const std::byte> packed, std::uint64_t bytes,
                                const std::string& name) {
    std::uint32_t size = 0;
    if (packed.size() >= sizeof(size)) {
        std::memcpy(&size, packed.data(), sizeof(size));
    }
    if (packed.size() < sizeof(size) || size != bytes) {
        corrupt(name, fmt::format("the block has {} bytes, but {} are expected", size, bytes));
    }
    return from_block(BlockPacking::lz4, packed.subspan(sizeof(size)), bytes, name);
}

std::vector<std::byte> without_checksum(ZarrCodec::Kind kind, std::vector<std::byte> packed,
                                        std::uint64_t bytes, const std::string& name) {
    if (packed.size() != bytes + kChecksum) {
        corrupt(name, fmt::format("there are {} bytes, but {} and a checksum are expected",
                                  packed.size(), bytes));
    }
    std::uint32_t stored = 0;
    std::uint32_t found = 0;
    if (kind == ZarrCodec::Kind::crc32c) {
        std::memcpy(&stored, packed.data() + bytes, kChecksum);
        packed.resize(bytes);
        found = crc32c(packed);
    } else {
        std::memcpy(&stored, packed.data(), kChecksum);
        packed.erase(packed.begin(), packed.begin() + kChecksum);
        const auto* const data = reinterpret_cast<const Bytef*>(packed.data());
        found = static_cast<std::uint32_t>(kind == ZarrCodec::Kind::crc32
                                               ? ::crc32_z(0, data, packed.size())
                                               : ::adler32_z(1, data, packed.size()));
    }
    if (found != stored) {
        corrupt(name, "the checksum is wrong");
    }
    return packed;
}

std::vector<std::byte> unshuffled(const std::vector<std::byte>& packed, std::size_t element,
                                  const std::string& name) {
    if (packed.size() % element != 0) {
        corrupt(name, fmt::format("{} bytes is not a multiple of the {} bytes of a number",
                                  packed.size(), element));
    }
    std::vector<std::byte> out(packed.size());
    const std::size_t count = packed.size() / element;
    for (std::size_t place = 0; place < element; ++place) {
        for (std::size_t i = 0; i < count; ++i) {
            out[i * element + place] = packed[place * count + i];
        }
    }
    return out;
}

/// The bits of a number; signed integers are extended to 64 bits.
std::uint64_t load(const std::byte* at, const ZarrNumber& number) {
    std::uint64_t bits = 0;
    for (std::size_t i = 0; i < number.bytes; ++i) {
        const std::size_t place = number.big_endian ? i : number.bytes - 1 - i;
        bits = bits << 8U | std::to_integer<std::uint64_t>(at[place]);
    }
    const auto unused = static_cast<unsigned>(64 - 8 * number.bytes);
    return number.kind == 'i' && unused > 0
               ? static_cast<std::uint64_t>(static_cast<std::int64_t>(bits << unused) >> unused)
               : bits;
}
void save(std::uint64_t bits, const ZarrNumber& number, std::byte* at) {
    for (std::size_t i = 0; i < number.bytes; ++i) {
        at[number.big_endian ? number.bytes - 1 - i : i] = static_cast<std::byte>(bits & 0xFFU);
        bits >>= 8U;
    }
}
double load_real(const std::byte* at, const ZarrNumber& number) {
    const std::uint64_t bits = load(at, number);
    switch (number.kind) {
        case 'i':
            return static_cast<double>(static_cast<std::int64_t>(bits));
        case 'f':
            return number.bytes == sizeof(float)
                       ? static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(bits)))
                       : std::bit_cast<double>(bits);
        default:
            return static_cast<double>(bits);
    }
}
/// Converts as in C; values beyond the range of an integer type are clamped to it.
void save_real(double value, const ZarrNumber& number, std::byte* at) {
    if (number.kind == 'f') {
        return save(number.bytes == sizeof(float)
                        ? std::bit_cast<std::uint32_t>(static_cast<float>(value))
                        : std::bit_cast<std::uint64_t>(value),
                    number, at);
    }
    const int bits = static_cast<int>(8 * number.bytes) - (number.kind == 'i' ? 1 : 0);
    const double end = std::ldexp(1.0, bits);
    const double low = number.kind == 'i' ? -end : 0;
    if (std::isnan(value)) {
        value = 0;
    }
    value = std::trunc(std::clamp(value, low, std::nextafter(end, 0.0)));
    save(number.kind == 'i' ? static_cast<std::uint64_t>(static_cast<std::int64_t>(value))
                            : static_cast<std::uint64_t>(value),
         number, at);
}

/// Sums wrap around like integers of the decoded type, and are rounded like its numbers.
template <class Sum, class Load, class Save>
void add_up(std::size_t count, const Load& load_one, const Save& save_one) {
    Sum sum{};
    for (std::size_t i = 0; i < count; ++i) {
        const auto step = static_cast<Sum>(load_one(i));
        sum = i == 0 ? step : static_cast<Sum>(sum + step);
        save_one(i, sum);
    }
}

std::vector<std::byte> from_numbers(const ZarrCodec& codec, const std::vector<std::byte>& packed,
                                    std::uint64_t bytes, const std::string& name) {
    const ZarrNumber& made = codec.made;
    const ZarrNumber& stored = codec.stored;
    const std::size_t count = packed.size() / stored.bytes;
    if (count * stored.bytes != packed.size() || count * made.bytes != bytes) {
        corrupt(name, fmt::format("{} numbers in {} bytes do not decode to {} bytes", count,
                                  packed.size(), bytes));
    }
    std::vector<std::byte> out(bytes);
    const auto from = [&](std::size_t i) { return packed.data() + i * stored.bytes; };
    const auto to = [&](std::size_t i) { return out.data() + i * made.bytes; };
    if (codec.kind == ZarrCodec::Kind::scaled) {
        const bool is_single = stored.kind == 'f' && stored.bytes == sizeof(float);
        for (std::size_t i = 0; i < count; ++i) {
            const double value = load_real(from(i), stored);
            save_real(is_single ? static_cast<double>(static_cast<float>(value) /
                                                          static_cast<float>(codec.scale) +
                                                      static_cast<float>(codec.offset))
                                : value / codec.scale + codec.offset,
                      made, to(i));
        }
    } else if (made.kind != 'f') {
        add_up<std::uint64_t>(
            count, [&](std::size_t i) { return load(from(i), stored); },
            [&](std::size_t i, std::uint64_t sum) { save(sum, made, to(i)); });
    } else {
        const auto load_one = [&](std::size_t i) { return load_real(from(i), stored); };
        const auto save_one = [&](std::size_t i, auto sum) {
            save_real(static_cast<double>(sum), made, to(i));
        };
        if (made.bytes == sizeof(float)) {
            add_up<float>(count, load_one, save_one);
        } else {
            add_up<double>(count, load_one, save_one);
        }
    }
    return out;
}

/// Undoes one codec. `bytes`: size of its output.
std::vector<std::byte> undo(const ZarrCodec& codec, std::vector<std::byte> packed,
                            std::uint64_t bytes, const std::string& name) {
    using Kind = ZarrCodec::Kind;
    switch (codec.kind) {
        case Kind::zlib:
        case Kind::gzip:
            return inflated(packed, bytes, name);
        case Kind::zstd:
            return from_zstd(packed, bytes, name);
        case Kind::blosc:
            return from_blosc(packed, bytes, name);
        case Kind::lz4:
            return from_lz4(packed, bytes, name);
        case Kind::bzip2:
            return from_block(BlockPacking::bzip2, packed, bytes, name);
        case Kind::lzma:
            return from_block(BlockPacking::lzma, packed, bytes, name);
        case Kind::crc32c:
        case Kind::crc32:
        case Kind::adler32:
            return without_checksum(codec.kind, std::move(packed), bytes, name);
        case Kind::shuffle:
            return unshuffled(packed, codec.element, name);
        case Kind::delta:
        case Kind::scaled:
            return from_numbers(codec, packed, bytes, name);
        case Kind::same:
            break;
    }
    return packed;
}

/// The size after encoding, and after decoding, `bytes` bytes; none for compressors.
std::optional<std::uint64_t> encoded_bytes(const ZarrCodec& codec, std::uint64_t bytes) {
    switch (codec.kind) {
        case ZarrCodec::Kind::crc32c:
        case ZarrCodec::Kind::crc32:
        case ZarrCodec::Kind::adler32:
            return bytes + kChecksum;
        case ZarrCodec::Kind::delta:
        case ZarrCodec::Kind::scaled:
            return bytes / codec.made.bytes * codec.stored.bytes;
        case ZarrCodec::Kind::shuffle:
        case ZarrCodec::Kind::same:
            return bytes;
        default:
            return std::nullopt;
    }
}
std::optional<std::uint64_t> decoded_bytes(const ZarrCodec& codec, std::uint64_t bytes) {
    switch (codec.kind) {
        case ZarrCodec::Kind::crc32c:
        case ZarrCodec::Kind::crc32:
        case ZarrCodec::Kind::adler32:
            return bytes - std::min<std::uint64_t>(bytes, kChecksum);
        case ZarrCodec::Kind::shuffle:
        case ZarrCodec::Kind::same:
            return bytes;
        default:
            return std::nullopt;
    }
}

const nlohmann::json& option(const nlohmann::json& options, const char* key) {
    static const nlohmann::json null;
    const auto it = options.is_object() ? options.find(key) : options.end();
    return !options.is_object() || it == options.end() ? null : *it;
}

/// "<i2" or "int16": integers and floating point numbers of up to 64 bits.
ZarrNumber number_type(const nlohmann::json& given, const std::string& codec,
                       const std::string& name) {
    const std::string text = given.is_string() ? given.get<std::string>() : "";
    std::string_view rest = text;
    ZarrNumber number;
    number.big_endian = rest.starts_with('>');
    if (!rest.empty() && std::string_view("<>|=").find(rest[0]) != std::string_view::npos) {
        rest.remove_prefix(1);
    }
    std::size_t size = 0;
    constexpr std::array<std::pair<std::string_view, char>, 3> kNames{
        {{"uint", 'u'}, {"int", 'i'}, {"float", 'f'}}};
    const auto* const found = std::find_if(
        kNames.begin(), kNames.end(), [&](const auto& one) { return rest.starts_with(one.first); });
    const bool in_bits = found != kNames.end();
    if (in_bits) {
        number.kind = found->second;
        rest.remove_prefix(found->first.size());
    } else if (!rest.empty()) {
        number.kind = rest[0];
        rest.remove_prefix(1);
    }
    const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), size);
    number.bytes = in_bits ? size / 8 : size;
    const bool is_size = number.bytes == 4 || number.bytes == 8 ||
                         (number.kind != 'f' && (number.bytes == 1 || number.bytes == 2));
    if (error != std::errc{} || end != rest.data() + rest.size() || !is_size ||
        (number.kind != 'i' && number.kind != 'u' && number.kind != 'f') ||
        (in_bits && size % 8 != 0)) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("the filter '{:.40}' is not supported for the type {:.40}; "
                                "integers, float32 and float64 are",
                                codec, given.dump()));
    }
    return number;
}

void set_numbers(const nlohmann::json& options, const std::string& id, const std::string& name,
                 ZarrCodec& codec) {
    const nlohmann::json& type = option(options, "dtype");
    const nlohmann::json& stored = option(options, "astype");
    codec.made = number_type(type, id, name);
    codec.stored = number_type(stored.is_null() ? type : stored, id, name);
    if (codec.kind == ZarrCodec::Kind::delta &&
        (codec.made.kind == 'f') != (codec.stored.kind == 'f')) {
        throw Error(
            ErrorKind::unsupported, {name},
            "the filter 'delta' between integers and floating point numbers is not supported");
    }
    if (codec.kind == ZarrCodec::Kind::scaled) {
        const nlohmann::json& scale = option(options, "scale");
        const nlohmann::json& offset = option(options, "offset");
        codec.scale = scale.is_number() ? scale.get<double>() : 0;
        codec.offset = offset.is_number() ? offset.get<double>() : NAN;
        if (codec.scale == 0 || !std::isfinite(codec.scale) || !std::isfinite(codec.offset)) {
            throw Error(ErrorKind::corrupt, {name},
                        fmt::format("the filter '{}' has an invalid scale {:.40} or offset {:.40}",
                                    id, scale.dump(), offset.dump()));
        }
    }
}

/// Throws if the library for the block is missing.
ZarrCodec block_codec(ZarrCodec::Kind kind, BlockPacking packing, const std::string& id,
                      const std::string& name) {
    const std::string package = missing_package(packing);
    if (!package.empty()) {
        throw Error(
            ErrorKind::unsupported, {name},
            fmt::format("the chunks use the codec {}, which this build does not support", id),
            {{RemedyKind::install_package, package}});
    }
    return {.kind = kind};
}

/// zarr-python 3 writes this prefix before the names of numcodecs' codecs.
std::string_view without_prefix(std::string_view id) {
    constexpr std::string_view kPrefix = "numcodecs.";
    return id.starts_with(kPrefix) ? id.substr(kPrefix.size()) : id;
}

}  // namespace

bool is_of_numbers(const std::string& codec) {
    const std::string_view id = without_prefix(codec);
    return id == "delta" || id == "fixedscaleoffset" || id == "bitround" || id == "quantize";
}

ZarrCodec zarr_codec(const std::string& codec, const nlohmann::json& options,
                     const std::string& name) {
    using Kind = ZarrCodec::Kind;
    const std::string id(without_prefix(codec));
    constexpr std::array<std::pair<std::string_view, Kind>, 6> kPlain{{{"zlib", Kind::zlib},
                                                                       {"gzip", Kind::gzip},
                                                                       {"zstd", Kind::zstd},
                                                                       {"crc32c", Kind::crc32c},
                                                                       {"adler32", Kind::adler32},
                                                                       {"bitround", Kind::same}}};
    for (const auto& [plain, kind] : kPlain) {
        if (id == plain) {
            return {.kind = kind};
        }
    }
    if (id == "crc32") {
        if (option(options, "location") == "end") {
            throw Error(ErrorKind::unsupported, {name},
                        "a CRC-32 at the end of the chunks is not supported");
        }
        return {.kind = Kind::crc32};
    }
    if (id == "lz4") {
        return block_codec(Kind::lz4, BlockPacking::lz4, id, name);
    }
    if (id == "bz2") {
        return block_codec(Kind::bzip2, BlockPacking::bzip2, id, name);
    }
    if (id == "lzma") {
        constexpr int kRaw = 3;
        if (option(options, "format") == kRaw) {
            throw Error(ErrorKind::unsupported, {name},
                        "LZMA chunks without a header are not supported");
        }
        return block_codec(Kind::lzma, BlockPacking::lzma, id, name);
    }
    if (id == "blosc") {
#if ISONEST_WITH_BLOSC
        return {.kind = Kind::blosc};
#else
        throw Error(ErrorKind::unsupported, {name},
                    "the chunks use the codec blosc, which this build does not support",
                    {{RemedyKind::install_package, "libblosc-dev"}});
#endif
    }
    if (id == "shuffle") {
        constexpr std::uint64_t kDefault = 4;
        constexpr std::uint64_t kMax = 256;
        const nlohmann::json& size = option(options, "elementsize");
        const std::uint64_t element = size.is_null()              ? kDefault
                                      : size.is_number_unsigned() ? size.get<std::uint64_t>()
                                                                  : kMax + 1;
        if (element > kMax) {
            throw Error(ErrorKind::corrupt, {name},
                        fmt::format("numbers of {:.40} bytes cannot be shuffled", size.dump()));
        }
        return {.kind = Kind::shuffle, .element = std::max<std::size_t>(element, 1)};
    }
    if (id == "delta" || id == "fixedscaleoffset" || id == "quantize") {
        ZarrCodec numbers{.kind = id == "delta"      ? Kind::delta
                                  : id == "quantize" ? Kind::same
                                                     : Kind::scaled};
        set_numbers(options, id, name, numbers);
        if (numbers.kind == Kind::same && (numbers.made.kind != numbers.stored.kind ||
                                           numbers.made.bytes != numbers.stored.bytes)) {
            throw Error(ErrorKind::unsupported, {name},
                        "the filter 'quantize' is not supported if it changes the type");
        }
        return numbers;
    }
    throw Error(
        ErrorKind::unsupported, {name},
        fmt::format(
            "the codec '{:.40}' is not supported; zlib, gzip, zstd, blosc, lz4, bz2, lzma, crc32c, "
            "crc32, adler32, shuffle, delta, fixedscaleoffset, quantize and bitround are",
            codec));
}

std::uint64_t max_between(std::span<const ZarrCodec> codecs, std::uint64_t bytes) {
    std::uint64_t most = bytes;
    std::optional<std::uint64_t> made = bytes;
    for (const ZarrCodec& codec : codecs) {
        made = made ? encoded_bytes(codec, *made) : made;
        most = std::max(most, made.value_or(0));
    }
    return most;
}

std::uint64_t beside_codecs(std::span<const ZarrCodec> codecs, std::uint64_t bytes) {
    std::uint64_t most = 0;
    for (const ZarrCodec& codec : codecs) {
        using Kind = ZarrCodec::Kind;
        most = std::max(most, codec.kind == Kind::lzma    ? max_beside(BlockPacking::lzma, bytes)
                              : codec.kind == Kind::bzip2 ? max_beside(BlockPacking::bzip2, bytes)
                                                          : 0);
    }
    return most;
}

std::vector<std::byte> decode_zarr(std::vector<std::byte> packed, std::span<const ZarrCodec> codecs,
                                   std::uint64_t bytes, const std::string& name) {
    // The output size of a compressor is unknown, its input size is known; there is at most one
    // compressor.
    std::vector<std::optional<std::uint64_t>> sizes;
    std::optional<std::uint64_t> made = bytes;
    for (const ZarrCodec& codec : codecs) {
        sizes.push_back(made);
        made = made ? encoded_bytes(codec, *made) : made;
    }
    for (std::size_t i = codecs.size(); i-- > 0;) {
        const std::optional<std::uint64_t> size =
            sizes[i] ? sizes[i] : decoded_bytes(codecs[i], packed.size());
        if (!size) {
            throw Error(ErrorKind::unsupported, {name},
                        "chunks that are compressed twice are not supported");
        }
        packed = undo(codecs[i], std::move(packed), *size, name);
    }
    if (packed.size() != bytes) {
        corrupt(name, fmt::format("there are {} bytes, but {} are expected", packed.size(), bytes));
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
