#include "store/files/shared_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include <isonest/error.h>

#include "store/files/open_shared.h"

namespace isonest::detail {
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
