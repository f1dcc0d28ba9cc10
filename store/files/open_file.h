// Open files: read at an offset, mapped, or shared by several processes.
#pragma once

#include <sys/types.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <utility>

#include "store/files/output_file.h"

namespace isonest::detail {

// An open file that is closed with the object.

class FileDescriptor {
  public:
    /// Takes ownership; negative: no file.
    explicit FileDescriptor(int fd) : fd_(fd) {}
    FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
    FileDescriptor& operator=(FileDescriptor&& other) noexcept {
        std::swap(fd_, other.fd_);
        return *this;
    }
    FileDescriptor(const FileDescriptor&) = delete;
    FileDescriptor& operator=(const FileDescriptor&) = delete;
    ~FileDescriptor() {
        if (fd_ >= 0) {
            ::close(fd_);
        }
    }
    [[nodiscard]] int get() const { return fd_; }

  private:
    int fd_;
};

// Reading a given part of an open file.

/// Whether all bytes were read; else `errno` is the reason, or 0 if the file is shorter.
/// Thread-safe.
inline bool pread_whole(int fd, std::uint64_t offset, std::span<std::byte> to) {
    while (!to.empty()) {
        const ssize_t n = ::pread(fd, to.data(), to.size(), static_cast<off_t>(offset));
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n <= 0) {
            errno = n == 0 ? 0 : errno;
            return false;
        }
        to = to.subspan(static_cast<std::size_t>(n));
        offset += static_cast<std::uint64_t>(n);
    }
    return true;
}

// Opening a file into which several machines write at the same time, each at its own places.

/// As ::open(); returns the descriptor, or -1 and errno. NFS clients write back whole pages,
/// including their possibly outdated view of the bytes around those written; on NFS, writes
/// therefore go through at once and on their own.
int open_shared(const char* path, int flags, mode_t mode = 0);

// A file mapped read-only.

/// Thread-safety: const methods from any thread.
class MappedFile {
  public:
    /// Throws Error{not_found, io}. An empty file maps to an empty span.
    explicit MappedFile(const std::filesystem::path& path);
    /// Maps a file that is already open and stays open; `path` is for messages.
    MappedFile(int file, const std::filesystem::path& path);
    MappedFile(const MappedFile&) = delete;
    MappedFile& operator=(const MappedFile&) = delete;
    ~MappedFile();

    [[nodiscard]] std::span<const std::byte> bytes() const { return bytes_; }
    /// Tells the kernel that this range is needed soon.
    void prefetch(std::uint64_t offset, std::uint64_t size) const;

  private:
    void map(int file, const std::filesystem::path& path);

    std::span<const std::byte> bytes_;
};

// A file into which several processes write, each at its own places.

/// A file that another process has created. Thread-safety: write_at() from any thread.
class SharedFile {
  public:
    /// Does not follow links. Throws Error{io}.
    explicit SharedFile(std::filesystem::path path);
    SharedFile(const SharedFile&) = delete;
    SharedFile& operator=(const SharedFile&) = delete;
    ~SharedFile();
    /// Throws Error{io}.
    void write_at(std::uint64_t offset, std::span<const std::byte> bytes) const;
    /// Copies bytes of another file, starting at `from_offset`, in the kernel. Returns the number
    /// of copied bytes, 0 if the kernel cannot.
    [[nodiscard]] std::uint64_t copy_from(int from, std::uint64_t from_offset, std::uint64_t offset,
                                          std::uint64_t bytes) const;
    /// Syncs what was written to disk. Throws Error{io}.
    void close();

  private:
    std::filesystem::path path_;
    int fd_;
    mutable EarlyWriteBack early_;
};

}  // namespace isonest::detail
