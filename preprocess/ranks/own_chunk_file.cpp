#include "preprocess/ranks/own_chunk_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include <isonest/error.h>

#include "store/files/early_write_back.h"
#include "store/files/open_shared.h"

namespace isonest::detail {
namespace {

constexpr std::size_t kRowsAtOnce = 4096;
constexpr std::size_t kBytesAtOnce = std::size_t{1} << 20U;

/// A store that another rank has created.
class SharedStore {
  public:
    explicit SharedStore(const std::filesystem::path& path)
        : path_(path), fd_(open_shared(path.c_str(), O_WRONLY | O_CLOEXEC)) {
        if (fd_ < 0) {
            fail("open", errno);
        }
    }
    SharedStore(const SharedStore&) = delete;
    SharedStore& operator=(const SharedStore&) = delete;
    ~SharedStore() {
        if (fd_ >= 0) {
            ::close(fd_);
        }
    }
    void write_at(std::uint64_t offset, std::span<const std::byte> bytes) {
        while (!bytes.empty()) {
            const ssize_t n = ::pwrite(fd_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
            if (n < 0 && errno == EINTR) {
                continue;
            }
            if (n <= 0) {
                fail("write", n == 0 ? ENOSPC : errno);
            }
            early_.wrote(fd_, static_cast<std::uint64_t>(n));
            offset += static_cast<std::uint64_t>(n);
            bytes = bytes.subspan(static_cast<std::size_t>(n));
        }
    }
    /// Some bytes of another file, in the kernel; how many, 0 where it cannot.
    std::uint64_t copy_from(int from, std::uint64_t from_offset, std::uint64_t offset,
                            std::uint64_t bytes) {
        auto in = static_cast<loff_t>(from_offset);
        auto out = static_cast<loff_t>(offset);
        const ssize_t n = ::copy_file_range(from, &in, fd_, &out, bytes, 0);
        if (n > 0) {
            early_.wrote(fd_, static_cast<std::uint64_t>(n));
        }
        return static_cast<std::uint64_t>(std::max<ssize_t>(n, 0));
    }
    void close() {
        if (::fsync(fd_) != 0 || ::close(std::exchange(fd_, -1)) != 0) {
            fail("write to disk", errno);
        }
    }

  private:
    [[noreturn]] void fail(const char* what, int error) const {
        throw Error(ErrorKind::io, {path_.string()},
                    fmt::format("cannot {}: {}", what, std::strerror(error)));
    }

    const std::filesystem::path& path_;
    int fd_;
    EarlyWriteBack early_;
};

}  // namespace

void OwnChunkFile::add(const EncodedChunk& chunk) {
    bytes_.write_at(end_, chunk.bytes);
    end_ += chunk.bytes.size();
    pending_.push_back(chunk.row);
    if (pending_.size() == kRowsAtOnce) {
        flush();
    }
}

void OwnChunkFile::flush() {
    rows_.write_at(count_ * sizeof(ChunkRow), std::as_bytes(std::span(pending_)));
    count_ += pending_.size();
    pending_.clear();
}

std::span<ChunkRow> OwnChunkFile::rows() {
    if (!pending_.empty() || rows_.as<ChunkRow>().size() != count_) {
        flush();
        rows_.map(count_ * sizeof(ChunkRow));
    }
    return rows_.as<ChunkRow>();
}

std::uint64_t OwnChunkFile::write_into(const std::filesystem::path& store) const {
    SharedStore file(store);
    std::vector<std::byte> buffer;
    std::uint64_t from = 0;
    const std::span<const ChunkRow> rows = rows_.as<ChunkRow>();
    for (std::size_t i = 0; i < rows.size();) {
        // As many chunks as lie one behind the other there, too.
        const std::uint64_t offset = rows[i].offset;
        std::uint64_t bytes = 0;
        for (; i < rows.size() && rows[i].offset == offset + bytes; ++i) {
            bytes += rows[i].bytes;
        }
        for (std::uint64_t done = 0; done < bytes;) {
            const std::uint64_t most = std::min<std::uint64_t>(bytes - done, kBytesAtOnce);
            std::uint64_t n = file.copy_from(bytes_.descriptor(), from, offset + done, most);
            if (n == 0) {
                buffer.resize(kBytesAtOnce);
                const auto piece = std::span(buffer).first(static_cast<std::size_t>(most));
                bytes_.read_at(from, piece);
                file.write_at(offset + done, piece);
                n = most;
            }
            from += n;
            done += n;
        }
    }
    file.close();
    return from;
}

}  // namespace isonest::detail
