// Sources: https://zlib.net/manual.html, https://github.com/lz4/lz4/blob/dev/lib/lz4.h,
// https://tukaani.org/xz/liblzma-api/, https://sourceware.org/bzip2/manual/manual.html

#include "preprocess/sources/bytes/packed_block.h"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <string_view>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/bytes/input_file.h"

#if ISONEST_WITH_BZIP2
#include <bzlib.h>
#endif

#if ISONEST_WITH_LZ4
#include <lz4.h>
#endif

#if ISONEST_WITH_LZMA
#include <lzma.h>
#endif

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
    constexpr std::size_t kMax = std::numeric_limits<int>::max();
    return packed.size() <= kMax && out.size() <= kMax &&
           ::LZ4_decompress_safe(reinterpret_cast<const char*>(packed.data()),
                                 reinterpret_cast<char*>(out.data()),
                                 static_cast<int>(packed.size()),
                                 static_cast<int>(out.size())) == static_cast<int>(out.size());
}
#endif

#if ISONEST_WITH_LZMA
/// The dictionary size for a block of `bytes`: no match refers to bytes before the block.
std::uint32_t dictionary_for(std::uint32_t said, std::size_t bytes) {
    const std::size_t enough = std::max<std::size_t>(bytes, LZMA_DICT_SIZE_MIN);
    return static_cast<std::uint32_t>(std::min<std::size_t>(said, enough));
}

/// The older format: one byte of properties, four for the dictionary size, eight for the block
/// size.
bool unpack_lzma_alone(Packed packed, Unpacked out) {
    constexpr std::size_t kHeader = 13;
    constexpr std::size_t kDictionary = 1;
    if (packed.size() < kHeader) {
        return false;
    }
    std::array<std::uint8_t, kHeader> header{};
    std::memcpy(header.data(), packed.data(), kHeader);
    std::uint32_t dictionary = 0;
    for (std::size_t i = 0; i < sizeof(dictionary); ++i) {
        dictionary |= std::uint32_t{header.at(kDictionary + i)} << 8 * i;
    }
    dictionary = dictionary_for(dictionary, out.size());
    for (std::size_t i = 0; i < sizeof(dictionary); ++i) {
        header.at(kDictionary + i) = static_cast<std::uint8_t>(dictionary >> 8 * i);
    }
    lzma_stream stream = LZMA_STREAM_INIT;
    if (::lzma_alone_decoder(&stream, max_beside(BlockPacking::lzma, out.size())) != LZMA_OK) {
        return false;
    }
    stream.next_out = reinterpret_cast<std::uint8_t*>(out.data());
    stream.avail_out = out.size();
    stream.next_in = header.data();
    stream.avail_in = header.size();
    lzma_ret code = ::lzma_code(&stream, LZMA_RUN);
    if (code == LZMA_OK && stream.avail_in == 0) {
        stream.next_in = reinterpret_cast<const std::uint8_t*>(packed.data()) + kHeader;
        stream.avail_in = packed.size() - kHeader;
        code = ::lzma_code(&stream, LZMA_RUN);
        if (code == LZMA_OK) {
            code = ::lzma_code(&stream, LZMA_FINISH);
        }
    }
    const bool is_whole = code == LZMA_STREAM_END && stream.avail_out == 0;
    ::lzma_end(&stream);
    return is_whole;
}

/// The filters of an .xz block, whose options liblzma allocates.
struct XzFilters {
    XzFilters() { all.fill({LZMA_VLI_UNKNOWN, nullptr}); }
    XzFilters(const XzFilters&) = delete;
    XzFilters& operator=(const XzFilters&) = delete;
    ~XzFilters() {
        for (const lzma_filter& filter : all) {
            std::free(filter.options);
        }
    }
    std::array<lzma_filter, LZMA_FILTERS_MAX + 1> all{};
};

/// An .xz stream: a header, blocks, an index of them, a footer. Bytes after it are ignored.
/// Source: https://tukaani.org/xz/xz-file-format.txt
bool unpack_xz(Packed packed, Unpacked out) {
    const auto* const in = reinterpret_cast<const std::uint8_t*>(packed.data());
    lzma_stream_flags flags{};
    if (packed.size() < LZMA_STREAM_HEADER_SIZE ||
        ::lzma_stream_header_decode(&flags, in) != LZMA_OK) {
        return false;
    }
    const std::unique_ptr<lzma_index_hash, void (*)(lzma_index_hash*)> blocks(
        ::lzma_index_hash_init(nullptr, nullptr),
        [](lzma_index_hash* hash) { ::lzma_index_hash_end(hash, nullptr); });
    if (!blocks) {
        return false;
    }
    std::size_t at = LZMA_STREAM_HEADER_SIZE;
    std::size_t made = 0;
    constexpr std::uint8_t kIndex = 0;
    while (at < packed.size() && in[at] != kIndex) {
        XzFilters filters;
        lzma_block block{};
        block.version = 1;
        block.check = flags.check;
        block.header_size = lzma_block_header_size_decode(in[at]);
        block.filters = filters.all.data();
        if (block.header_size > packed.size() - at ||
            ::lzma_block_header_decode(&block, nullptr, in + at) != LZMA_OK) {
            return false;
        }
        for (const lzma_filter& filter : filters.all) {
            if (filter.id == LZMA_FILTER_LZMA2) {
                auto& options = *static_cast<lzma_options_lzma*>(filter.options);
                options.dict_size = dictionary_for(options.dict_size, out.size());
            }
        }
        at += block.header_size;
        if (::lzma_block_buffer_decode(&block, nullptr, in, &at, packed.size(),
                                       reinterpret_cast<std::uint8_t*>(out.data()), &made,
                                       out.size()) != LZMA_OK ||
            ::lzma_index_hash_append(blocks.get(), ::lzma_block_unpadded_size(&block),
                                     block.uncompressed_size) != LZMA_OK) {
            return false;
        }
    }
    lzma_stream_flags footer{};
    return made == out.size() && at < packed.size() &&
           ::lzma_index_hash_decode(blocks.get(), in, &at, packed.size()) == LZMA_STREAM_END &&
           packed.size() - at >= LZMA_STREAM_HEADER_SIZE &&
           ::lzma_stream_footer_decode(&footer, in + at) == LZMA_OK &&
           footer.backward_size == ::lzma_index_hash_size(blocks.get()) &&
           ::lzma_stream_flags_compare(&flags, &footer) == LZMA_OK;
}

bool unpack_lzma(Packed packed, Unpacked out) {
    constexpr std::array<std::uint8_t, 6> kXz{0xFD, '7', 'z', 'X', 'Z', 0};
    const bool is_xz =
        packed.size() >= kXz.size() && std::memcmp(packed.data(), kXz.data(), kXz.size()) == 0;
    return is_xz ? unpack_xz(packed, out) : unpack_lzma_alone(packed, out);
}
#endif

#if ISONEST_WITH_BZIP2
bool unpack_bzip2(Packed packed, Unpacked out) {
    constexpr std::size_t kMax = std::numeric_limits<unsigned>::max();
    if (packed.size() > kMax || out.size() > kMax) {
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

namespace {

constexpr std::uint64_t kMaxMembers = 250000;
constexpr std::uint64_t kMaxDirectory = std::uint64_t{1} << 26U;

class Reader {
  public:
    explicit Reader(const std::filesystem::path& path)
        : path_(path), size_(regular_file_size(path)) {}

    std::vector<ZipMember> read() {
        find_directory();
        std::vector<ZipMember> members;
        const std::string directory = bytes(at_, length_);
        std::size_t at = 0;
        for (std::uint64_t i = 0; i < count_; ++i) {
            members.push_back(member(directory, at));
        }
        return members;
    }

  private:
    [[noreturn]] void corrupt(const std::string& what) const {
        throw Error(ErrorKind::corrupt, {path_.string(), "ZIP directory"}, what);
    }
    /// Reads exactly these bytes or throws.
    [[nodiscard]] std::string bytes(std::uint64_t at, std::uint64_t count) const {
        if (at > size_ || count > size_ - at) {
            corrupt("it extends beyond the end of the file; was the file cut short?");
        }
        return first_bytes(path_, static_cast<std::size_t>(count), at);
    }

    void find_directory() {
        constexpr std::uint64_t kEnd = 22;
        constexpr std::uint64_t kMaxComment = 65535;
        const std::uint64_t length = std::min(size_, kEnd + kMaxComment);
        const std::string tail = bytes(size_ - length, length);
        const std::size_t end = tail.rfind("PK\5\6");
        if (end == std::string::npos || tail.size() - end < kEnd) {
            corrupt("not found at the end of the file; was the file cut short?");
        }
        count_ = number_at<std::uint16_t>(tail, end + 10, false);
        length_ = number_at<std::uint32_t>(tail, end + 12, false);
        at_ = number_at<std::uint32_t>(tail, end + 16, false);
        const bool small = count_ < 0xFFFFU && length_ < 0xFFFFFFFFU && at_ < 0xFFFFFFFFU;
        constexpr std::size_t kLocator = 20;
        if (!small && end >= kLocator && tail.compare(end - kLocator, 4, "PK\6\7") == 0) {
            constexpr std::size_t kEnd64 = 56;
            const std::string end64 =
                bytes(number_at<std::uint64_t>(tail, end - kLocator + 8, false), kEnd64);
            if (!end64.starts_with("PK\6\6")) {
                corrupt("the ZIP64 record is missing");
            }
            count_ = number_at<std::uint64_t>(end64, 32, false);
            length_ = number_at<std::uint64_t>(end64, 40, false);
            at_ = number_at<std::uint64_t>(end64, 48, false);
        }
        if (count_ > kMaxMembers || length_ > kMaxDirectory) {
            throw Error(ErrorKind::unsupported, {path_.string(), "ZIP directory"},
                        fmt::format("the directory is too large: {} members, where {} is the limit",
                                    count_, kMaxMembers));
        }
    }

    [[nodiscard]] ZipMember member(std::string_view directory, std::size_t& at) const {
        constexpr std::size_t kFixed = 46;
        if (directory.size() - at < kFixed || directory.substr(at, 4) != "PK\1\2") {
            corrupt(fmt::format("there is no entry at byte {} of the directory", at));
        }
        const auto part = directory.substr(at);
        const auto flags = number_at<std::uint16_t>(part, 8, false);
        const auto method = number_at<std::uint16_t>(part, 10, false);
        const std::size_t name = number_at<std::uint16_t>(part, 28, false);
        const std::size_t extra = number_at<std::uint16_t>(part, 30, false);
        const std::size_t comment = number_at<std::uint16_t>(part, 32, false);
        if (part.size() - kFixed < name + extra + comment) {
            corrupt("the last entry is cut short");
        }
        ZipMember m;
        m.name = part.substr(kFixed, name);
        m.crc = number_at<std::uint32_t>(part, 16, false);
        m.packed = number_at<std::uint32_t>(part, 20, false);
        m.bytes = number_at<std::uint32_t>(part, 24, false);
        std::uint64_t local = number_at<std::uint32_t>(part, 42, false);
        read_zip64(part.substr(kFixed + name, extra), m, local);
        constexpr unsigned kEncrypted = 1;
        constexpr int kDeflated = 8;
        m.deflated = method == kDeflated;
        m.readable = (flags & kEncrypted) == 0 && (method == 0 || m.deflated);
        constexpr std::size_t kLocal = 30;
        const std::string head = bytes(local, kLocal);
        if (!head.starts_with("PK\3\4")) {
            corrupt(fmt::format("'{:.80}' is not at the position in the directory", m.name));
        }
        m.start = local + kLocal + number_at<std::uint16_t>(head, 26, false) +
                  number_at<std::uint16_t>(head, 28, false);
        if (m.start > size_ || m.packed > size_ - m.start) {
            corrupt(fmt::format("'{:.80}' extends beyond the end of the file", m.name));
        }
        at += kFixed + name + extra + comment;
        return m;
    }

    /// The sizes and the offset that did not fit into 32 bits follow each other in an extra field.
    void read_zip64(std::string_view extra, ZipMember& m, std::uint64_t& local) const {
        constexpr std::uint64_t kElsewhere = 0xFFFFFFFFU;
        while (extra.size() >= 4) {
            const auto id = number_at<std::uint16_t>(extra, 0, false);
            const std::size_t length = number_at<std::uint16_t>(extra, 2, false);
            if (length > extra.size() - 4) {
                return;
            }
            if (id == 1) {
                std::string_view rest = extra.substr(4, length);
                for (std::uint64_t* const number : {&m.bytes, &m.packed, &local}) {
                    if (*number != kElsewhere) {
                        continue;
                    }
                    if (rest.size() < sizeof(std::uint64_t)) {
                        corrupt(fmt::format("'{:.80}' has no size", m.name));
                    }
                    *number = number_at<std::uint64_t>(rest, 0, false);
                    rest = rest.substr(sizeof(std::uint64_t));
                }
                return;
            }
            extra = extra.substr(4 + length);
        }
    }

    const std::filesystem::path& path_;
    std::uint64_t size_;
    std::uint64_t count_ = 0;
    std::uint64_t length_ = 0;
    std::uint64_t at_ = 0;
};

}  // namespace

std::vector<ZipMember> read_zip_directory(const std::filesystem::path& path) {
    return Reader(path).read();
}

}  // namespace isonest::detail
