#include "preprocess/raw_source.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <optional>
#include <vector>

#include "store/error.h"
#include "store/lattice.h"
#include "store/mapped_file.h"

namespace isonest {
namespace {

void swap_bytes(std::byte* data, std::uint64_t bytes, std::size_t size) {
    for (std::uint64_t i = 0; i + size <= bytes; i += size) {
        std::reverse(data + i, data + i + size);
    }
}

std::uint64_t data_bytes(const RawLayout& layout) {
    return static_cast<std::uint64_t>(layout.nodes.product()) * size_of(layout.type);
}

/// What both kinds of raw source share.
class RawBase : public VolumeSource {
  public:
    RawBase(std::filesystem::path path, std::string name, RawLayout layout)
        : path_(std::move(path)), name_(std::move(name)), layout_(std::move(layout)) {}
    [[nodiscard]] Int3 nodes() const override { return layout_.nodes; }
    [[nodiscard]] ValueType type() const override { return layout_.type; }
    [[nodiscard]] Double3 spacing() const override { return layout_.spacing; }
    [[nodiscard]] Double3 origin() const override { return layout_.origin; }
    [[nodiscard]] std::string name() const override { return name_; }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return layout_.header.empty() ? std::vector{path_} : std::vector{path_, layout_.header};
    }
    [[nodiscard]] std::string identity() const override {
        return fmt::format("{}offset {}\nbig endian {}\n", VolumeSource::identity(), layout_.offset,
                           layout_.big_endian);
    }
    [[nodiscard]] Granularity granularity() const override { return {}; }

    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) final {
        const std::uint64_t row =
            static_cast<std::uint64_t>(layout_.nodes.x) * size_of(layout_.type);
        const auto rows = static_cast<std::uint64_t>(ny);
        const bool whole = ny == layout_.nodes.y;
        const std::int64_t pieces = whole ? 1 : nz;
        const std::uint64_t bytes = row * rows * (whole ? static_cast<std::uint64_t>(nz) : 1);
        for (std::int64_t p = 0; p < pieces; ++p) {
            const auto at =
                static_cast<std::uint64_t>((z0 + p) * layout_.nodes.y + y0) * row + layout_.offset;
            read_bytes(at, dst, bytes);
            if (layout_.big_endian && size_of(layout_.type) > 1) {
                swap_bytes(dst, bytes, size_of(layout_.type));
            }
            dst += bytes;
        }
    }

  protected:
    virtual void read_bytes(std::uint64_t at, std::byte* dst, std::uint64_t bytes) = 0;
    std::filesystem::path path_;
    std::string name_;
    RawLayout layout_;
};

class PlainSource : public RawBase {
  public:
    PlainSource(const std::filesystem::path& path, std::string name, const RawLayout& layout)
        : RawBase(path, std::move(name), layout), fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
        if (fd_ < 0) {
            throw Error(ErrorKind::io,
                        fmt::format("{}: cannot open: {}", name_, std::strerror(errno)));
        }
        const std::size_t size = size_of(layout.type);
        if ((!layout.big_endian || size == 1) && layout.offset % size == 0) {
            map_.emplace(path);
        }
    }
    PlainSource(const PlainSource&) = delete;
    PlainSource& operator=(const PlainSource&) = delete;
    ~PlainSource() override { ::close(fd_); }
    [[nodiscard]] bool sequential() const override { return false; }
    [[nodiscard]] std::span<const std::byte> mapped() const override {
        return map_ ? map_->bytes().subspan(layout_.offset, data_bytes(layout_))
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
                throw Error(ErrorKind::io,
                            fmt::format("{}: cannot read at byte {}: {}", name_, at,
                                        n == 0 ? "the file ends there; did it shrink?"
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

class GzipSource : public RawBase {
  public:
    GzipSource(const std::filesystem::path& path, std::string name, const RawLayout& layout)
        : GzipSource(path, std::move(name), layout, 0) {}
    /// The stream starts `skip` bytes into the file.
    GzipSource(const std::filesystem::path& path, std::string name, const RawLayout& layout,
               std::uint64_t skip)
        : RawBase(path, std::move(name), layout) {
        const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
        if (fd >= 0 && ::lseek(fd, static_cast<off_t>(skip), SEEK_SET) >= 0) {
            file_ = ::gzdopen(fd, "rb");
        }
        if (file_ == nullptr) {
            if (fd >= 0) {
                ::close(fd);
            }
            throw Error(ErrorKind::io,
                        fmt::format("{}: cannot open: {}", name_, std::strerror(errno)));
        }
        ::gzbuffer(file_, 1U << 18U);
    }
    GzipSource(const GzipSource&) = delete;
    GzipSource& operator=(const GzipSource&) = delete;
    ~GzipSource() override { ::gzclose(file_); }
    [[nodiscard]] bool sequential() const override { return true; }

  private:
    [[noreturn]] void fail() {
        int code = 0;
        const int error = errno;
        const char* const text = ::gzerror(file_, &code);
        if (code == Z_OK || code == Z_STREAM_END) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("{}: its decompressed data end at byte {}, but {} x {} x {} "
                                    "nodes of {} after {} bytes need {}",
                                    name_, at_, layout_.nodes.x, layout_.nodes.y, layout_.nodes.z,
                                    name_of(layout_.type), layout_.offset,
                                    layout_.offset + data_bytes(layout_)));
        }
        if (code == Z_ERRNO) {
            throw Error(ErrorKind::io,
                        fmt::format("{}: cannot read: {}", name_, std::strerror(error)));
        }
        throw Error(ErrorKind::corrupt,
                    fmt::format("{}: damaged gzip stream near byte {}: {}", name_, at_, text));
    }
    void fetch(std::byte* dst, std::uint64_t bytes) {
        while (bytes > 0) {
            const auto part = static_cast<unsigned>(std::min<std::uint64_t>(bytes, 1U << 26U));
            const int n = ::gzread(file_, dst, part);
            if (n <= 0) {
                fail();
            }
            dst += n;
            at_ += static_cast<std::uint64_t>(n);
            bytes -= static_cast<std::uint64_t>(n);
        }
    }
    void read_bytes(std::uint64_t at, std::byte* dst, std::uint64_t bytes) override {
        std::vector<std::byte> skipped(1U << 16U);
        while (at_ < at) {
            fetch(skipped.data(), std::min<std::uint64_t>(at - at_, skipped.size()));
        }
        fetch(dst, bytes);
        if (at_ == layout_.offset + data_bytes(layout_)) {
            // The end brings the checksum; anything more is not what the dimensions say.
            std::byte more{};
            const int n = ::gzread(file_, &more, 1);
            if (n < 0) {
                fail();
            }
            if (n > 0 && layout_.exact_length) {
                throw Error(ErrorKind::invalid_argument,
                            fmt::format("{}: there are more than the {} bytes that {} x {} x {} "
                                        "nodes of {} need; check --dims and --type",
                                        name_, at_, layout_.nodes.x, layout_.nodes.y,
                                        layout_.nodes.z, name_of(layout_.type)));
            }
        }
    }
    gzFile file_ = nullptr;
    std::uint64_t at_ = 0;
};

}  // namespace

std::uint64_t regular_file_size(const std::filesystem::path& path) {
    struct stat status {};
    if (::stat(path.c_str(), &status) != 0) {
        throw Error(errno == ENOENT ? ErrorKind::not_found : ErrorKind::io,
                    fmt::format("{}: {}", path.string(), std::strerror(errno)));
    }
    if (!S_ISREG(status.st_mode)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{}: not a regular file", path.string()));
    }
    if (status.st_size == 0) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{}: the file is empty", path.string()));
    }
    return static_cast<std::uint64_t>(status.st_size);
}

std::string first_bytes(const std::filesystem::path& path, std::size_t count) {
    std::string text(count, '\0');
    const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (fd < 0) {
        throw Error(ErrorKind::io,
                    fmt::format("{}: cannot open: {}", path.string(), std::strerror(errno)));
    }
    const ssize_t n = ::pread(fd, text.data(), count, 0);
    const int error = errno;
    ::close(fd);
    if (n < 0) {
        throw Error(ErrorKind::io,
                    fmt::format("{}: cannot read: {}", path.string(), std::strerror(error)));
    }
    text.resize(static_cast<std::size_t>(n));
    return text;
}

bool is_gzip(const std::filesystem::path& path) {
    return first_bytes(path, 2) == "\x1F\x8B";
}

namespace {
void check_nodes(const std::string& name, const RawLayout& layout) {
    for (int axis = 0; axis < 3; ++axis) {
        if (layout.nodes[axis] < 1 || layout.nodes[axis] > kMaxNodesPerAxis) {
            throw Error(
                ErrorKind::unsupported,
                fmt::format("{}: {} x {} x {} nodes: each axis must have 1 to {}", name,
                            layout.nodes.x, layout.nodes.y, layout.nodes.z, kMaxNodesPerAxis));
        }
    }
}
}  // namespace

std::unique_ptr<VolumeSource> open_gzip_behind(const std::filesystem::path& path,
                                               const std::string& name, std::uint64_t skip,
                                               const RawLayout& layout) {
    check_nodes(name, layout);
    return std::make_unique<GzipSource>(path, name, layout, skip);
}

std::unique_ptr<VolumeSource> open_raw(const std::filesystem::path& path, const std::string& name,
                                       const RawLayout& given) {
    RawLayout layout = given;
    check_nodes(name, layout);
    const std::uint64_t size = regular_file_size(path);
    if (is_gzip(path)) {
        if (layout.offset_from_end) {
            throw Error(ErrorKind::unsupported,
                        name + ": 'byte skip: -1' does not go with gzip encoding");
        }
        return std::make_unique<GzipSource>(path, name, layout);
    }
    const std::uint64_t need = data_bytes(layout);
    if (layout.offset_from_end && size >= need) {
        layout.offset = size - need;
    }
    if (size < need || size - need < layout.offset ||
        (layout.exact_length && size - need != layout.offset)) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("{}: {} x {} x {} nodes of {} after {} bytes need {} bytes, but the "
                        "file has {}; check --dims, --type and --offset",
                        name, layout.nodes.x, layout.nodes.y, layout.nodes.z, name_of(layout.type),
                        layout.offset, need + layout.offset, size));
    }
    return std::make_unique<PlainSource>(path, name, layout);
}

}  // namespace isonest
