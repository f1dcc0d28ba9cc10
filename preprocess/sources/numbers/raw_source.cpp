#include "preprocess/sources/numbers/raw_source.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <optional>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/gzip_stream.h"
#include "preprocess/sources/bytes/regular_file.h"
#include "preprocess/sources/numbers/far_numbers.h"
#include "preprocess/sources/numbers/raw_rows.h"
#include "preprocess/sources/numbers/strided_file.h"
#include "preprocess/sources/wrapping/described_source.h"
#include "store/files/mapped_file.h"
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

/// The numbers of a stream of deflate, from its front to its end.
class StreamedNumbers {
  public:
    /// The stream starts at layout.start. `name` and `layout` outlive this.
    StreamedNumbers(const InputFile& file, const std::string& name, const RawLayout& layout)
        : name_(name),
          layout_(layout),
          stream_(file, name, layout.start, wrapper_of(layout.packing)) {}

    void fetch(std::byte* dst, std::uint64_t bytes) {
        const std::uint64_t n = stream_.read(dst, bytes);
        at_ += n;
        if (n < bytes) {
            throw Error(ErrorKind::invalid_argument, {name_},
                        fmt::format("its decompressed data end at byte {}, but {} after {} bytes "
                                    "need {}",
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
    /// Only the end brings the checksum.
    void require_right_end() {
        std::vector<std::byte> skipped(1U << 16U);
        constexpr std::uint64_t kMostBehind = std::uint64_t{1} << 30U;
        const std::uint64_t most = std::max(kMostBehind, 16 * at_);
        std::uint64_t behind = 0;
        while (const std::uint64_t n = stream_.read(skipped.data(), skipped.size())) {
            if (layout_.exact_length) {
                throw Error(ErrorKind::invalid_argument, {name_},
                            fmt::format("there are more than the {} bytes that {} need", at_,
                                        text_of_nodes(layout_)),
                            {{RemedyKind::correct_numbers, "dims,type"}});
            }
            behind += n;
            if (behind > most) {
                throw Error(ErrorKind::unsupported, {name_},
                            fmt::format("more than {} bytes follow the {} that are data; "
                                        "decompress it and use encoding: raw",
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

/// Numbers that were unpacked to temporary space, which is kept as long as they are read. Who they
/// are, the packed file says.
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

/// For axes in an order that a stream cannot be read in. The array, not what is around it, is
/// copied to the system's folder for temporary files.
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

/// The numbers are not compressed. The layout's `offset` becomes that of the file.
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
            fmt::format("{} after {} bytes need {} bytes, but the file has {}{}",
                        text_of_nodes(layout), layout.start + skipped,
                        need + layout.start + skipped, size,
                        raw ? "" : "; check the sizes, the type and what is skipped in its header"),
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
                fmt::format("'line skip: {}', but the file has only {} lines there", lines, found));
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
            throw Error(
                ErrorKind::unsupported, {name},
                "data that are the end of the file (byte skip: -1) do not go with compression");
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
    if (file.is_far()) {
        return open_far_numbers(file, name, layout);
    }
    if (layout.strides) {
        return open_strided(file.path(), name, layout);
    }
    return std::make_unique<PlainSource>(file.path(), name, layout);
}

}  // namespace isonest::detail
