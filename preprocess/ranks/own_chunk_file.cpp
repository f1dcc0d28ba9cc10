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
    std::vector<std::byte> buffer(kBytesAtOnce);
    std::uint64_t from = 0;
    for (const ChunkRow& row : rows_.as<ChunkRow>()) {
        for (std::uint64_t done = 0; done < row.bytes;) {
            const auto piece = std::span(buffer).first(
                static_cast<std::size_t>(std::min<std::uint64_t>(row.bytes - done, kBytesAtOnce)));
            bytes_.read_at(from, piece);
            file.write_at(row.offset + done, piece);
            from += piece.size();
            done += piece.size();
        }
    }
    file.close();
    return from;
}

}  // namespace isonest::detail
