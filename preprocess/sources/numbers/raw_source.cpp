#include "preprocess/sources/numbers/raw_source.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/memory_volume.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/stream_bytes.h"
#include "preprocess/sources/numbers/raw_rows.h"
#include "preprocess/sources/numbers/remote_numbers.h"
#include "preprocess/sources/wrapping/wrapped_source.h"
#include "store/files/open_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {
namespace {

class PlainSource : public RawBase {
  public:
    PlainSource(const std::filesystem::path& path, std::string name, const RawLayout& layout)
        : RawBase(path, std::move(name), layout), fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
        if (fd_ < 0) {
            throw Error(ErrorKind::io, {name_},
                        fmt::format("cannot open: {}", std::strerror(errno)));
        }
        const std::size_t size = size_of(layout.type);
        if ((!layout.big_endian || size == 1) && start() % size == 0) {
            map_.emplace(path);
        }
    }
    PlainSource(const PlainSource&) = delete;
    PlainSource& operator=(const PlainSource&) = delete;
    ~PlainSource() override { ::close(fd_); }
    [[nodiscard]] std::span<const std::byte> mapped() const override {
        return map_ ? map_->bytes().subspan(start(), volume_bytes(layout_))
                    : std::span<const std::byte>{};
    }

  private:
    void read_bytes(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        while (bytes > 0) {
            const ssize_t n = ::pread(fd_, dst, bytes, static_cast<off_t>(at));
            if (n < 0 && errno == EINTR) {
                continue;
            }
            if (n <= 0) {
                throw Error(
                    ErrorKind::io, {name_, fmt::format("byte {}", at)},
                    fmt::format("cannot read: {}", n == 0 ? "the file ends there; did it shrink?"
                                                          : std::strerror(errno)));
            }
            dst += n;
            at += static_cast<std::uint64_t>(n);
            bytes -= static_cast<std::uint64_t>(n);
        }
    }
    int fd_;
    std::optional<MappedFile> map_;
};

DeflateWrapper wrapper_of(Packing packing) {
    return packing == Packing::zlib      ? DeflateWrapper::zlib
           : packing == Packing::deflate ? DeflateWrapper::none
                                         : DeflateWrapper::gzip;
}

/// The numbers of a deflate stream, from front to back.
class StreamedNumbers {
  public:
    /// The stream starts at layout.start. `name` and `layout` must outlive this object.
    StreamedNumbers(const InputFile& file, const std::string& name, const RawLayout& layout)
        : name_(name),
          layout_(layout),
          stream_(file, name, layout.start, wrapper_of(layout.packing)) {}

    void fetch(std::byte* dst, std::uint64_t bytes) {
        const std::uint64_t n = stream_.read(dst, bytes);
        at_ += n;
        if (n < bytes) {
            throw Error(
                ErrorKind::invalid_argument, {name_},
                fmt::format(
                    "the decompressed data end at byte {}, but {} after {} bytes need {} bytes",
                    at_, text_of_nodes(layout_), layout_.offset,
                    layout_.offset + data_bytes(layout_)));
        }
    }
    void skip_to(std::uint64_t at) {
        std::vector<std::byte> skipped(1U << 16U);
        while (at_ < at) {
            fetch(skipped.data(), std::min<std::uint64_t>(at - at_, skipped.size()));
        }
    }
    /// Reads to the end, because the checksum is there.
    void require_right_end() {
        std::vector<std::byte> skipped(1U << 16U);
        constexpr std::uint64_t kMaxBehind = std::uint64_t{1} << 30U;
        const std::uint64_t most = std::max(kMaxBehind, 16 * at_);
        std::uint64_t behind = 0;
        while (const std::uint64_t n = stream_.read(skipped.data(), skipped.size())) {
            if (layout_.exact_length) {
                throw Error(
                    ErrorKind::invalid_argument, {name_},
                    fmt::format("the decompressed data have more than the {} bytes that {} need",
                                at_, text_of_nodes(layout_)),
                    {{RemedyKind::correct_numbers, "dims,type"}});
            }
            behind += n;
            if (behind > most) {
                throw Error(ErrorKind::unsupported, {name_},
                            fmt::format("more than {} bytes follow the {} bytes of data; "
                                        "decompress the file and use encoding: raw",
                                        most, at_));
            }
        }
    }

  private:
    const std::string& name_;
    const RawLayout& layout_;
    GzipStream stream_;
    std::uint64_t at_ = 0;
};

class GzipSource : public RawBase {
  public:
    GzipSource(const InputFile& file, std::string name, const RawLayout& layout)
        : RawBase(file, std::move(name), layout), numbers_(file, name_, layout_) {}
    [[nodiscard]] bool sequential() const override { return true; }

  private:
    void read_bytes(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        numbers_.skip_to(at);
        numbers_.fetch(dst, bytes);
    }
    void after_last() override {
        numbers_.skip_to(layout_.offset + data_bytes(layout_));
        numbers_.require_right_end();
    }
    StreamedNumbers numbers_;
};

/// Numbers decompressed to temporary space, which exists as long as this source. Their identity is
/// that of the compressed file.
class UnpackedNumbers : public DescribedSource {
  public:
    UnpackedNumbers(std::unique_ptr<VolumeSource> inner, ScratchFile copy, InputFile file,
                    RawLayout layout)
        : DescribedSource(std::move(inner)),
          copy_(std::move(copy)),
          file_(std::move(file)),
          layout_(std::move(layout)) {}
    [[nodiscard]] std::string identity() const override { return identity_of_raw(file_, layout_); }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return local_files({file_, layout_.header});
    }

  private:
    ScratchFile copy_;
    InputFile file_;
    RawLayout layout_;
};

/// For axis orders in which a stream cannot be read. Only the array itself is copied to the
/// system's folder for temporary files.
std::unique_ptr<VolumeSource> open_unpacked(const InputFile& file, const std::string& name,
                                            const RawLayout& layout) {
    StreamedNumbers numbers(file, name, layout);
    numbers.skip_to(layout.offset);
    ScratchFile copy{ScratchFolder(temporary_folder())};
    std::vector<std::byte> part(std::size_t{1} << 20U);
    const std::uint64_t all = data_bytes(layout);
    for (std::uint64_t at = 0; at < all;) {
        const auto n = static_cast<std::size_t>(std::min<std::uint64_t>(all - at, part.size()));
        numbers.fetch(part.data(), n);
        copy.write_at(at, {part.data(), n});
        at += n;
    }
    numbers.require_right_end();
    RawLayout plain = layout;
    plain.offset = 0;
    auto source = open_strided(fmt::format("/proc/self/fd/{}", copy.descriptor()), name, plain);
    return std::make_unique<UnpackedNumbers>(std::move(source), std::move(copy), file, layout);
}

/// For uncompressed numbers. The layout's `offset` becomes relative to the file.
void place_plain(const std::string& name, std::uint64_t size, RawLayout& layout) {
    const std::uint64_t need = data_bytes(layout);
    const std::uint64_t skipped = layout.offset;
    const bool fits = size >= layout.start && size - layout.start >= need &&
                      size - layout.start - need >= skipped;
    layout.offset = layout.offset_from_end && fits ? size - need : layout.start + skipped;
    if (!fits || (layout.exact_length && size - need != layout.offset)) {
        const bool raw = layout.packing == Packing::recognised;
        throw Error(
            ErrorKind::invalid_argument, {name},
            fmt::format(
                "{} after {} bytes need {} bytes, but the file has {}{}", text_of_nodes(layout),
                layout.start + skipped, need + layout.start + skipped, size,
                raw ? "" : "; check the sizes, the type and the skipped bytes in its header"),
            raw ? std::vector<Remedy>{{RemedyKind::correct_numbers, "dims,type,offset"}}
                : std::vector<Remedy>{});
    }
}

}  // namespace

std::uint64_t behind_lines(const InputFile& file, const std::string& name, std::uint64_t at,
                           std::uint64_t lines) {
    constexpr std::size_t kPart = std::size_t{1} << 16U;
    std::uint64_t found = 0;
    while (found < lines) {
        const std::string part = first_bytes(file, kPart, at);
        if (part.empty()) {
            throw Error(
                ErrorKind::corrupt, {name},
                fmt::format("'line skip: {}', but only {} lines follow the header", lines, found));
        }
        std::size_t used = 0;
        for (; found < lines && used != part.size(); ++found) {
            const std::size_t end = part.find('\n', used);
            if (end == std::string::npos) {
                used = part.size();
                break;
            }
            used = end + 1;
        }
        at += used;
    }
    return at;
}

std::unique_ptr<VolumeSource> open_raw(const InputFile& file, const std::string& name,
                                       const RawLayout& given) {
    RawLayout layout = given;
    check_nodes(name, layout);
    const std::uint64_t size = regular_file_size(file);
    layout.start = behind_lines(file, name, layout.start, layout.lines);
    const bool gzip = is_gzip(file, layout.start);
    const bool deflated = layout.packing == Packing::zlib || layout.packing == Packing::deflate;
    if (deflated || layout.packing == Packing::gzip ||
        (layout.packing == Packing::recognised && gzip)) {
        if (!gzip && !deflated) {
            throw Error(ErrorKind::corrupt, {name, fmt::format("byte {}", layout.start)},
                        "the header says encoding gzip, but no gzip stream starts here");
        }
        if (layout.offset_from_end) {
            throw Error(ErrorKind::unsupported, {name},
                        "byte skip: -1 is not possible with compression");
        }
        if (!is_nested(layout)) {
            return open_unpacked(file, name, layout);
        }
        return std::make_unique<GzipSource>(file, name, layout);
    }
    place_plain(name, size, layout);
    if (gzip && size - layout.start != given.offset + data_bytes(layout)) {
        throw Error(ErrorKind::corrupt, {name, fmt::format("byte {}", layout.start)},
                    "the header says encoding raw, but a gzip stream starts here");
    }
    if (file.is_remote()) {
        return open_remote_numbers(file, name, layout);
    }
    if (layout.strides) {
        return open_strided(file.path(), name, layout);
    }
    return std::make_unique<PlainSource>(file.path(), name, layout);
}

namespace {

class ReaderSource : public RawBase {
  public:
    ReaderSource(std::unique_ptr<ByteReader> bytes, const std::string& name,
                 const RawLayout& layout, const InputFile& file)
        : RawBase(file, name, layout), bytes_(std::move(bytes)) {}
    [[nodiscard]] bool sequential() const override { return bytes_->sequential(); }
    [[nodiscard]] std::uint64_t heap() const override { return RawBase::heap() + bytes_->heap(); }

  private:
    void read_bytes(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        bytes_->read(at, dst, bytes);
    }
    void after_last() override { bytes_->finish(); }
    std::unique_ptr<ByteReader> bytes_;
};

}  // namespace

std::unique_ptr<VolumeSource> open_bytes(std::unique_ptr<ByteReader> bytes, const std::string& name,
                                         const RawLayout& layout, const InputFile& file) {
    check_nodes(name, layout);
    const std::uint64_t need = layout.offset + data_bytes(layout);
    if (bytes->size() < need) {
        throw Error(ErrorKind::corrupt, {name},
                    fmt::format("{} need {} bytes, but there are {}", text_of_nodes(layout), need,
                                bytes->size()));
    }
    if (bytes->sequential() && !is_nested(layout)) {
        throw Error(
            ErrorKind::unsupported, {name},
            "the axes are stored in another order, in which a compressed stream cannot be read");
    }
    return std::make_unique<ReaderSource>(std::move(bytes), name, layout, file);
}

namespace {

class StridedFile : public VolumeSource {
  public:
    StridedFile(const std::filesystem::path& path, std::string name, const RawLayout& layout)
        : path_(path), name_(std::move(name)), layout_(layout), map_(path) {
        const auto value =
            layout.strides_in_bytes ? 1 : static_cast<std::int64_t>(size_of(layout.type));
        MemoryLayout memory;
        memory.strides = *layout.strides * value;
        memory.name = name_;
        volume_.emplace(
            map_.bytes().data() + layout.offset + layout.first * static_cast<std::uint64_t>(value),
            layout.type, layout.nodes, memory);
    }
    [[nodiscard]] VolumeDescription describe() const override {
        return {layout_.nodes,     layout_.type, layout_.spacing, layout_.origin, name_,
                layout_.direction, false,        layout_.unit,    layout_.frame};
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return local_files({path_, layout_.header});
    }
    [[nodiscard]] std::string identity() const override { return identity_of_raw(path_, layout_); }
    /// Reads together what is contiguous in the file.
    [[nodiscard]] Granularity granularity() const override {
        return layout_.strides->z < layout_.strides->y ? Granularity{layout_.nodes.z, 1}
                                                       : Granularity{};
    }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        volume_->read(z0, nz, y0, ny, dst);
        const std::size_t value = size_of(layout_.type);
        if (layout_.big_endian && value > 1) {
            swap_bytes(dst, static_cast<std::uint64_t>(nz * ny * layout_.nodes.x) * value, value);
        }
    }

  private:
    std::filesystem::path path_;
    std::string name_;
    RawLayout layout_;
    MappedFile map_;
    std::optional<MemoryVolume> volume_;
};

}  // namespace

std::unique_ptr<VolumeSource> open_strided(const std::filesystem::path& path,
                                           const std::string& name, const RawLayout& layout) {
    return std::make_unique<StridedFile>(path, name, layout);
}

namespace {

/// File offset of the numbers in an uncompressed file.
std::uint64_t start_of_piece(const InputFile& file, const RawLayout& layout, std::uint64_t piece) {
    const std::uint64_t size = regular_file_size(file);
    const std::uint64_t start = behind_lines(file, file.name(), layout.start, layout.lines);
    const bool fits =
        size >= start && size - start >= piece && size - start - piece >= layout.offset;
    if (!fits) {
        throw Error(
            ErrorKind::invalid_argument, {file.name()},
            fmt::format(
                "the file needs {} bytes of data after {} skipped bytes, but has only {} bytes",
                piece, start + layout.offset, size));
    }
    return layout.offset_from_end ? size - piece : start + layout.offset;
}

}  // namespace

bool is_numbered(const std::string& pattern) {
    constexpr std::size_t kMaxDigits = 2;
    const std::size_t sign = pattern.find('%');
    const std::size_t letter = pattern.find_first_not_of("0123456789", sign + 1);
    return sign != std::string::npos && letter != std::string::npos && pattern[letter] == 'd' &&
           letter - sign - 1 <= kMaxDigits && pattern.find('%', letter) == std::string::npos;
}

std::vector<std::string> numbered_names(const std::string& pattern, std::int64_t first,
                                        std::int64_t last, std::int64_t step) {
    constexpr std::int64_t kMax = std::int64_t{1} << 31U;
    if (!is_numbered(pattern) || step == 0 || std::abs(first) > kMax || std::abs(last) > kMax ||
        std::abs(step) > kMax || (step > 0 ? last < first : last > first) ||
        static_cast<std::uint64_t>((last - first) / step) >= kMaxPieces) {
        return {};
    }
    const std::size_t sign = pattern.find('%');
    const std::size_t letter = pattern.find('d', sign);
    const std::string digits = pattern.substr(sign + 1, letter - sign - 1);
    const int width = digits.empty() ? 0 : std::stoi(digits);
    std::vector<std::string> names;
    for (std::int64_t i = 0; i <= (last - first) / step; ++i) {
        const std::int64_t number = first + i * step;
        names.push_back(pattern.substr(0, sign) +
                        (digits.starts_with('0') ? fmt::format("{:0{}}", number, width)
                                                 : fmt::format("{:{}}", number, width)) +
                        pattern.substr(letter + 1));
    }
    return names;
}

std::vector<InputFile> pieces_beside(const InputFile& header,
                                     const std::vector<std::string>& names) {
    if (header.is_remote()) {
        throw Error(ErrorKind::unsupported, {header.name()},
                    "the data are in several files, which cannot be read from a URL",
                    {{RemedyKind::download}});
    }
    std::vector<InputFile> files;
    files.reserve(names.size());
    for (const std::string& name : names) {
        files.push_back(header.beside(name));
    }
    return files;
}

std::unique_ptr<ByteReader> bytes_of_pieces(const std::vector<InputFile>& files,
                                            const RawLayout& layout, std::uint64_t piece) {
    const bool packed = layout.packing == Packing::gzip || layout.packing == Packing::zlib;
    if (packed && layout.offset_from_end) {
        throw Error(ErrorKind::unsupported, {files.front().name()},
                    "byte skip: -1 is not possible with compression");
    }
    for (const InputFile& file : files) {
        if (packed) {
            regular_file_size(file);
        } else {
            static_cast<void>(start_of_piece(file, layout, piece));
        }
    }
    return joined_bytes(files, piece, packed, [layout, piece, packed](const InputFile& file) {
        if (!packed) {
            return file_bytes(file, start_of_piece(file, layout, piece), piece);
        }
        const std::uint64_t start = behind_lines(file, file.name(), layout.start, layout.lines);
        return deflated_bytes({file, start, layout.offset, piece}, layout.packing == Packing::gzip
                                                                       ? DeflateWrapper::gzip
                                                                       : DeflateWrapper::zlib);
    });
}

}  // namespace isonest::detail
