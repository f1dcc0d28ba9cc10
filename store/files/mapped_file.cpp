#include "store/files/mapped_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include <isonest/error.h>

namespace isonest::detail {

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

}  // namespace isonest::detail
