// The format: G. Turk, "The PLY Polygon File Format" (1994).
#include "query/ply_writer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "store/error.h"
#include "store/output_file.h"

namespace isonest {
namespace {

/// A file under its temporary name; removed unless published.
class OutputFile {
  public:
    OutputFile(std::filesystem::path path, bool force)
        : path_(std::move(path)), temporary_(temporary_name(path_)), force_(force) {
        check_output(path_, force_);
        ::unlink(temporary_.c_str());
        fd_ = ::open(temporary_.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666);
        if (fd_ < 0) {
            fail("create", errno);
        }
    }
    OutputFile(const OutputFile&) = delete;
    OutputFile& operator=(const OutputFile&) = delete;
    ~OutputFile() {
        if (fd_ >= 0) {
            ::close(fd_);
            ::unlink(temporary_.c_str());
        }
    }
    void write_at(std::uint64_t offset, const void* data, std::size_t size) const {
        const auto* p = static_cast<const std::byte*>(data);
        while (size > 0) {
            const ssize_t n = ::pwrite(fd_, p, size, static_cast<off_t>(offset));
            if (n < 0 && errno == EINTR) {
                continue;
            }
            if (n <= 0) {
                fail("write", n == 0 ? ENOSPC : errno);
            }
            p += n;
            offset += static_cast<std::uint64_t>(n);
            size -= static_cast<std::size_t>(n);
        }
    }
    void publish_as_named() {
        publish(temporary_, path_, force_);
        ::close(fd_);
        fd_ = -1;
    }

  private:
    [[noreturn]] void fail(const char* what, int error) const {
        throw Error(ErrorKind::io,
                    fmt::format("{}: cannot {}: {}", path_.string(), what, std::strerror(error)));
    }
    std::filesystem::path path_;
    std::filesystem::path temporary_;
    bool force_;
    int fd_ = -1;
};

constexpr std::size_t kVertexBytes = 3 * sizeof(float);
constexpr std::size_t kFaceBytes = 1 + 3 * sizeof(std::uint32_t);

}  // namespace

void write_ply(const std::filesystem::path& path, bool force, const PartStore& parts,
               const Weld& weld, Progress& progress) {
    if (weld.vertices() > 0xFFFFFFFFULL) {
        throw Error(ErrorKind::limit,
                    fmt::format("{}: the surface has {} vertices, more than PLY can number (2^32 - "
                                "1); extract a --box of it or allow a larger --error",
                                path.string(), weld.vertices()));
    }
    OutputFile file(path, force);
    const std::string header = fmt::format(
        "ply\nformat binary_little_endian 1.0\ncomment isonest\nelement vertex {}\n"
        "property float x\nproperty float y\nproperty float z\nelement face {}\n"
        "property list uchar {} vertex_indices\nend_header\n",
        weld.vertices(), weld.triangles(), weld.vertices() > 0x7FFFFFFFULL ? "uint" : "int");
    file.write_at(0, header.data(), header.size());
    const std::uint64_t faces = header.size() + weld.vertices() * kVertexBytes;
    const auto records = parts.records();
    progress.begin("write mesh", weld.triangles(), "triangles");
    tbb::parallel_for(std::size_t{0}, records.size(), [&](std::size_t i) {
        progress.check();
        const PartRecord& r = records[i];
        std::vector<std::uint64_t> number;
        std::vector<bool> owned;
        weld.numbers(r, number, owned);
        std::vector<std::byte> buffer;
        buffer.resize(r.owned * kVertexBytes);
        std::size_t at = 0;
        const auto vertices = parts.vertices(r);
        for (std::size_t v = 0; v < vertices.size(); ++v) {
            if (owned[v]) {
                std::memcpy(buffer.data() + at, vertices[v].data(), kVertexBytes);
                at += kVertexBytes;
            }
        }
        file.write_at(header.size() + r.first_vertex * kVertexBytes, buffer.data(), at);
        buffer.resize(r.triangles * kFaceBytes);
        at = 0;
        for (const auto& t : parts.triangles(r)) {
            buffer[at++] = std::byte{3};
            for (const std::uint32_t v : t) {
                const auto index = static_cast<std::uint32_t>(number[v]);
                std::memcpy(buffer.data() + at, &index, sizeof(index));
                at += sizeof(index);
            }
        }
        file.write_at(faces + r.first_triangle * kFaceBytes, buffer.data(), at);
        progress.advance(r.triangles);
    });
    file.publish_as_named();
}

}  // namespace isonest
