#include "store/files/open_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/magic.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include <isonest/error.h>

namespace isonest::detail {

int open_shared(const char* path, int flags, mode_t mode) {
    const int fd = ::open(path, flags, mode);
    struct statfs system {};
    if (fd < 0 || ::fstatfs(fd, &system) != 0 || system.f_type != NFS_SUPER_MAGIC) {
        return fd;
    }
    // The client extends a write to its page unless the descriptor is synchronous
    // (nfs_can_extend_write), which cannot be set later.
    const int again = ::open(path, (flags & ~(O_CREAT | O_EXCL | O_TRUNC)) | O_DSYNC);
    ::close(fd);
    return again;
}

MappedFile::MappedFile(const std::filesystem::path& path) {
    const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0) {
        throw Error(errno == ENOENT ? ErrorKind::not_found : ErrorKind::io, {path.string()},
                    fmt::format("cannot open: {}", std::strerror(errno)));
    }
    try {
        map(fd, path);
    } catch (...) {
        ::close(fd);
        throw;
    }
    ::close(fd);
}

MappedFile::MappedFile(int file, const std::filesystem::path& path) {
    map(file, path);
}

void MappedFile::map(int file, const std::filesystem::path& path) {
    struct stat status {};
    void* p = nullptr;
    int error = 0;
    if (::fstat(file, &status) != 0) {
        error = errno;
    } else if (!S_ISREG(status.st_mode)) {
        throw Error(ErrorKind::invalid_argument, {path.string()}, "not a regular file");
    } else if (status.st_size > 0) {
        p = ::mmap(nullptr, static_cast<std::size_t>(status.st_size), PROT_READ, MAP_SHARED, file,
                   0);
        error = p == MAP_FAILED ? errno : 0;
    }
    if (error != 0) {
        throw Error(ErrorKind::io, {path.string()},
                    fmt::format("cannot map: {}", std::strerror(error)));
    }
    if (p != nullptr) {
        bytes_ = {static_cast<const std::byte*>(p), static_cast<std::size_t>(status.st_size)};
    }
}

MappedFile::~MappedFile() {
    if (!bytes_.empty()) {
        ::munmap(const_cast<std::byte*>(bytes_.data()), bytes_.size());
    }
}

void MappedFile::prefetch(std::uint64_t offset, std::uint64_t size) const {
    const std::uint64_t page = 4096;
    const std::uint64_t from = offset / page * page;
    if (offset + size <= bytes_.size()) {
        ::madvise(const_cast<std::byte*>(bytes_.data() + from), offset + size - from,
                  MADV_WILLNEED);
    }
}

namespace {

[[noreturn]] void fail_on_shared(const std::filesystem::path& path, const char* what, int error) {
    throw Error(ErrorKind::io, {path.string()},
                fmt::format("cannot {}: {}", what, std::strerror(error)));
}

}  // namespace

SharedFile::SharedFile(std::filesystem::path path)
    : path_(std::move(path)), fd_(open_shared(path_.c_str(), O_WRONLY | O_CLOEXEC | O_NOFOLLOW)) {
    if (fd_ < 0) {
        fail_on_shared(path_, "open", errno);
    }
}

SharedFile::~SharedFile() {
    if (fd_ >= 0) {
        ::close(fd_);
    }
}

void SharedFile::write_at(std::uint64_t offset, std::span<const std::byte> bytes) const {
    while (!bytes.empty()) {
        const ssize_t n = ::pwrite(fd_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n <= 0) {
            fail_on_shared(path_, "write", n == 0 ? ENOSPC : errno);
        }
        early_.wrote(fd_, static_cast<std::uint64_t>(n));
        offset += static_cast<std::uint64_t>(n);
        bytes = bytes.subspan(static_cast<std::size_t>(n));
    }
}

std::uint64_t SharedFile::copy_from(int from, std::uint64_t from_offset, std::uint64_t offset,
                                    std::uint64_t bytes) const {
    auto in = static_cast<loff_t>(from_offset);
    auto out = static_cast<loff_t>(offset);
    const ssize_t n = ::copy_file_range(from, &in, fd_, &out, bytes, 0);
    if (n > 0) {
        early_.wrote(fd_, static_cast<std::uint64_t>(n));
    }
    return static_cast<std::uint64_t>(std::max<ssize_t>(n, 0));
}

void SharedFile::close() {
    if (::fsync(fd_) != 0 || ::close(std::exchange(fd_, -1)) != 0) {
        fail_on_shared(path_, "write to disk", errno);
    }
}

}  // namespace isonest::detail
