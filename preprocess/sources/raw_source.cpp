#include "preprocess/sources/raw_source.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <optional>
#include <vector>

#include <isonest/error.h>
#include <isonest/memory_volume.h>

#include "preprocess/sources/byte_reader.h"
#include "preprocess/sources/file_identity.h"
#include "preprocess/sources/gzip_stream.h"
#include "store/files/mapped_file.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

void swap_bytes(std::byte* data, std::uint64_t bytes, std::size_t size) {
    for (std::uint64_t i = 0; i + size <= bytes; i += size) {
        std::reverse(data + i, data + i + size);
    }
}

std::uint64_t volume_bytes(const RawLayout& layout) {
    return static_cast<std::uint64_t>(layout.nodes.product()) * size_of(layout.type);
}

/// Of the array that the volume is, or is a part of.
std::uint64_t data_bytes(const RawLayout& layout) {
    return layout.whole > 0 ? layout.whole * size_of(layout.type) : volume_bytes(layout);
}

std::string text_of_nodes(const RawLayout& layout) {
    std::string text = fmt::format("{} x {} x {} nodes of {}", layout.nodes.x, layout.nodes.y,
                                   layout.nodes.z, name_of(layout.type));
    return layout.whole > 0 ? fmt::format("{} values ({} are taken)", layout.whole, text) : text;
}

/// What both kinds of raw source share.
class RawBase : public VolumeSource {
  public:
    RawBase(std::filesystem::path path, std::string name, RawLayout layout)
        : path_(std::move(path)), name_(std::move(name)), layout_(std::move(layout)) {}
    [[nodiscard]] VolumeDescription describe() const override {
        return {layout_.nodes,  layout_.type, layout_.spacing,
                layout_.origin, name_,        layout_.direction};
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return layout_.header.empty() ? std::vector{path_} : std::vector{path_, layout_.header};
    }
    [[nodiscard]] std::string identity() const override {
        return fmt::format("{}offset {}\nbig endian {}\n", identity_of(files()), layout_.offset,
                           layout_.big_endian) +
               (layout_.strides ? fmt::format("strides {} {} {}\n", layout_.strides->x,
                                              layout_.strides->y, layout_.strides->z)
                                : "") +
               (layout_.first > 0 ? fmt::format("first value {}\n", layout_.first) : "");
    }

    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) final {
        const std::size_t value = size_of(layout_.type);
        const std::uint64_t row = static_cast<std::uint64_t>(layout_.nodes.x) * value;
        if (layout_.strides) {
            read_rows(z0, nz, y0, ny, dst);
        } else {
            const auto rows = static_cast<std::uint64_t>(ny);
            const bool whole = ny == layout_.nodes.y;
            const std::int64_t pieces = whole ? 1 : nz;
            const std::uint64_t bytes = row * rows * (whole ? static_cast<std::uint64_t>(nz) : 1);
            for (std::int64_t p = 0; p < pieces; ++p) {
                const auto at =
                    static_cast<std::uint64_t>((z0 + p) * layout_.nodes.y + y0) * row + start();
                read_bytes(at, dst + static_cast<std::uint64_t>(p) * bytes, bytes);
            }
        }
        if (layout_.big_endian && value > 1) {
            swap_bytes(dst, static_cast<std::uint64_t>(nz * ny) * row, value);
        }
        if (z0 + nz == layout_.nodes.z && y0 + ny == layout_.nodes.y) {
            after_last();
        }
    }

  protected:
    virtual void read_bytes(std::uint64_t at, std::byte* dst, std::uint64_t bytes) = 0;
    /// The last node was read.
    virtual void after_last() {}
    /// The byte of node (0, 0, 0).
    [[nodiscard]] std::uint64_t start() const {
        return layout_.offset + layout_.first * size_of(layout_.type);
    }
    std::filesystem::path path_;
    std::string name_;
    RawLayout layout_;

  private:
    /// Of each row what lies between its nodes is read too.
    void read_rows(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
                   std::byte* dst) {
        const std::size_t value = size_of(layout_.type);
        const Int3 strides = *layout_.strides;
        const auto step = static_cast<std::size_t>(strides.x) * value;
        std::vector<std::byte> buffer(static_cast<std::size_t>(layout_.nodes.x - 1) * step + value);
        for (std::int64_t i = 0; i < nz * ny; ++i) {
            const std::int64_t z = z0 + i / ny;
            const std::int64_t y = y0 + i % ny;
            read_bytes(start() + static_cast<std::uint64_t>(z * strides.z + y * strides.y) * value,
                       buffer.data(), buffer.size());
            for (std::size_t x = 0; x < static_cast<std::size_t>(layout_.nodes.x); ++x) {
                std::memcpy(dst, buffer.data() + x * step, value);
                dst += value;
            }
        }
    }
};

/// Whether rows follow each other, and planes, none inside of another one.
bool is_nested(const RawLayout& layout) {
    const Int3 n = layout.nodes;
    const Int3 s = layout.strides.value_or(Int3{1, n.x, n.x * n.y});
    const std::int64_t row = (n.x - 1) * s.x + 1;
    return (n.y == 1 || s.y >= row) && (n.z == 1 || s.z >= (n.y - 1) * s.y + row);
}

/// Numbers whose bytes a ByteReader makes.
class ReaderSource : public RawBase {
  public:
    ReaderSource(std::unique_ptr<ByteReader> bytes, const std::string& name,
                 const RawLayout& layout, std::vector<std::filesystem::path> files)
        : RawBase(files.front(), name, layout),
          bytes_(std::move(bytes)),
          files_(std::move(files)) {}
    [[nodiscard]] std::vector<std::filesystem::path> files() const override { return files_; }
    [[nodiscard]] bool sequential() const override { return bytes_->sequential(); }
    [[nodiscard]] std::uint64_t heap() const override { return RawBase::heap() + bytes_->heap(); }

  private:
    void read_bytes(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        bytes_->read(at, dst, bytes);
    }
    std::unique_ptr<ByteReader> bytes_;
    std::vector<std::filesystem::path> files_;
};

/// Part of an array in a file without compression, in any order of its axes: what memory can show,
/// a map of the file can.
class StridedFile : public VolumeSource {
  public:
    StridedFile(const std::filesystem::path& path, std::string name, const RawLayout& layout)
        : path_(path), name_(std::move(name)), layout_(layout), map_(path) {
        const auto value = static_cast<std::int64_t>(size_of(layout.type));
        MemoryLayout memory;
        memory.strides = *layout.strides * value;
        memory.name = name_;
        volume_.emplace(
            map_.bytes().data() + layout.offset + layout.first * static_cast<std::uint64_t>(value),
            layout.type, layout.nodes, memory);
    }
    [[nodiscard]] VolumeDescription describe() const override {
        return {layout_.nodes,  layout_.type, layout_.spacing,
                layout_.origin, name_,        layout_.direction};
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return layout_.header.empty() ? std::vector{path_} : std::vector{path_, layout_.header};
    }
    [[nodiscard]] std::string identity() const override {
        return fmt::format("{}offset {}\nbig endian {}\nfirst value {}\nstrides {} {} {}\n",
                           identity_of(files()), layout_.offset, layout_.big_endian, layout_.first,
                           layout_.strides->x, layout_.strides->y, layout_.strides->z);
    }
    /// What lies together in the file is best read together.
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

class GzipSource : public RawBase {
  public:
    /// The stream starts at layout.start.
    GzipSource(const std::filesystem::path& path, std::string name, const RawLayout& layout)
        : RawBase(path, std::move(name), layout),
          stream_(path, name_, layout.start, wrapper_of(layout.packing)) {}
    [[nodiscard]] bool sequential() const override { return true; }

  private:
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
    void skip_to(std::uint64_t at) {
        std::vector<std::byte> skipped(1U << 16U);
        while (at_ < at) {
            fetch(skipped.data(), std::min<std::uint64_t>(at - at_, skipped.size()));
        }
    }
    void read_bytes(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        skip_to(at);
        fetch(dst, bytes);
    }
    void after_last() override {
        skip_to(layout_.offset + data_bytes(layout_));
        require_right_end();
    }
    GzipStream stream_;
    std::uint64_t at_ = 0;
};

}  // namespace

std::uint64_t regular_file_size(const std::filesystem::path& path) {
    struct stat status {};
    if (::stat(path.c_str(), &status) != 0) {
        throw Error(errno == ENOENT ? ErrorKind::not_found : ErrorKind::io, {path.string()},
                    std::strerror(errno));
    }
    if (!S_ISREG(status.st_mode)) {
        throw Error(ErrorKind::invalid_argument, {path.string()}, "not a regular file");
    }
    if (status.st_size == 0) {
        throw Error(ErrorKind::invalid_argument, {path.string()}, "the file is empty");
    }
    return static_cast<std::uint64_t>(status.st_size);
}

std::string first_bytes(const std::filesystem::path& path, std::size_t count, std::uint64_t at) {
    std::string text(count, '\0');
    const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (fd < 0) {
        throw Error(ErrorKind::io, {path.string()},
                    fmt::format("cannot open: {}", std::strerror(errno)));
    }
    const ssize_t n = ::pread(fd, text.data(), count, static_cast<off_t>(at));
    const int error = errno;
    ::close(fd);
    if (n < 0) {
        throw Error(ErrorKind::io, {path.string()},
                    fmt::format("cannot read: {}", std::strerror(error)));
    }
    text.resize(static_cast<std::size_t>(n));
    return text;
}

namespace {
void check_nodes(const std::string& name, const RawLayout& layout) {
    for (int axis = 0; axis < 3; ++axis) {
        if (layout.nodes[axis] < 1 || layout.nodes[axis] > kMaxNodesPerAxis) {
            throw Error(
                ErrorKind::unsupported, {name},
                fmt::format("{} x {} x {} nodes: each axis must have 1 to {}", layout.nodes.x,
                            layout.nodes.y, layout.nodes.z, kMaxNodesPerAxis));
        }
    }
}
/// The place behind `lines` lines from byte `at` on.
std::uint64_t behind_lines(const std::filesystem::path& path, const std::string& name,
                           std::uint64_t at, std::uint64_t lines) {
    constexpr std::size_t kPart = std::size_t{1} << 16U;
    std::uint64_t found = 0;
    while (found < lines) {
        const std::string part = first_bytes(path, kPart, at);
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

std::unique_ptr<VolumeSource> open_raw(const std::filesystem::path& path, const std::string& name,
                                       const RawLayout& given) {
    RawLayout layout = given;
    check_nodes(name, layout);
    const std::uint64_t size = regular_file_size(path);
    layout.start = behind_lines(path, name, layout.start, layout.lines);
    const bool gzip = is_gzip(path, layout.start);
    const bool deflated = layout.packing == Packing::zlib || layout.packing == Packing::deflate;
    if (deflated || layout.packing == Packing::gzip ||
        (layout.packing == Packing::recognised && gzip)) {
        if (!gzip && !deflated) {
            throw Error(ErrorKind::corrupt, {name, fmt::format("byte {}", layout.start)},
                        "the header says encoding gzip, but no gzip stream starts here");
        }
        if (layout.offset_from_end) {
            throw Error(ErrorKind::unsupported, {name},
                        "data at the end of the file cannot be found in a compressed one");
        }
        if (!is_nested(layout)) {
            throw Error(ErrorKind::unsupported, {name},
                        "its axes are stored in another order, which a compressed stream cannot be "
                        "read in; decompress it");
        }
        return std::make_unique<GzipSource>(path, name, layout);
    }
    place_plain(name, size, layout);
    if (gzip && size - layout.start != given.offset + data_bytes(layout)) {
        throw Error(ErrorKind::corrupt, {name, fmt::format("byte {}", layout.start)},
                    "the header says encoding raw, but a gzip stream starts here");
    }
    if (layout.strides) {
        return std::make_unique<StridedFile>(path, name, layout);
    }
    return std::make_unique<PlainSource>(path, name, layout);
}

std::unique_ptr<VolumeSource> open_bytes(std::unique_ptr<ByteReader> bytes, const std::string& name,
                                         const RawLayout& layout,
                                         std::vector<std::filesystem::path> files) {
    check_nodes(name, layout);
    const std::uint64_t need = layout.offset + data_bytes(layout);
    if (bytes->size() < need) {
        throw Error(ErrorKind::corrupt, {name},
                    fmt::format("{} need {} bytes, but there are {}", text_of_nodes(layout), need,
                                bytes->size()));
    }
    if (bytes->sequential() && !is_nested(layout)) {
        throw Error(ErrorKind::unsupported, {name},
                    "its axes are stored in another order, which a stream cannot be read in");
    }
    return std::make_unique<ReaderSource>(std::move(bytes), name, layout, std::move(files));
}

namespace {

std::unique_ptr<VolumeSource> open_numbers(const VolumeInput& input, const SourceOptions& options) {
    const std::filesystem::path& path = input.path();
    if (!options.dims || !options.type) {
        std::string names;
        for (const InputFormat& format : input_formats()) {
            names += fmt::format("{}{}{}", names.empty() ? "" : ", ", format.name,
                                 format.package.empty() ? "" : " (not in this build)");
        }
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    fmt::format("none of the formats that are recognised ({}); raw numbers have to "
                                "be described",
                                names),
                    {{RemedyKind::describe_numbers, "dims,type"}});
    }
    RawLayout layout;
    layout.nodes = *options.dims;
    layout.type = *options.type;
    layout.big_endian = options.big_endian.value_or(false);
    layout.offset = options.offset.value_or(0);
    return open_raw(path, path.string(), layout);
}

}  // namespace

VolumeFormat raw_format() {
    return {.about = {"raw numbers", ".raw .bin .gz", ""},
            .takes = {.numbers = true},
            .recognises = [](const VolumeInput& input) { return !input.folder; },
            .open = open_numbers};
}

}  // namespace isonest::detail
