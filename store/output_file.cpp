#include "store/output_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

#include "store/error.h"

namespace isonest {
namespace {

std::filesystem::path folder_of(const std::filesystem::path& path) {
    const std::filesystem::path folder = path.parent_path();
    return folder.empty() ? std::filesystem::path(".") : folder;
}

void sync(const std::filesystem::path& path, int flags) {
    const int fd = ::open(path.c_str(), flags | O_CLOEXEC);
    if (fd < 0 || ::fsync(fd) != 0) {
        const int error = errno;
        if (fd >= 0) {
            ::close(fd);
        }
        throw Error(ErrorKind::io, fmt::format("{}: cannot write to disk: {}", path.string(),
                                               std::strerror(error)));
    }
    ::close(fd);
}

[[noreturn]] void exists_already(const std::filesystem::path& path) {
    throw Error(
        ErrorKind::invalid_argument,
        fmt::format("{} exists; give --force to replace it, or another name", path.string()));
}

}  // namespace

std::filesystem::path temporary_prefix(const std::filesystem::path& path) {
    return folder_of(path) / fmt::format(".{}.partial-", path.filename().string());
}

std::filesystem::path temporary_name(const std::filesystem::path& path) {
    // In containers, process ids come again: what another run left is not to be overwritten.
    const std::string first = (temporary_prefix(path) += std::to_string(::getpid())).string();
    std::string name = first;
    std::error_code ignored;
    for (int i = 2; std::filesystem::exists(std::filesystem::symlink_status(name, ignored)); ++i) {
        name = fmt::format("{}-{}", first, i);
    }
    return name;
}

void check_output(const std::filesystem::path& path, bool force) {
    std::error_code ignored;
    if (path.filename().empty() || std::filesystem::is_directory(path, ignored)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} is a folder; give a file name", path.string()));
    }
    if (!std::filesystem::is_directory(folder_of(path), ignored)) {
        throw Error(ErrorKind::not_found, fmt::format("{}: there is no folder {}", path.string(),
                                                      folder_of(path).string()));
    }
    if (!force && std::filesystem::exists(path, ignored)) {
        exists_already(path);
    }
}

void require_other_file(const std::filesystem::path& output, const std::filesystem::path& input) {
    std::error_code ignored;
    if (std::filesystem::equivalent(output, input, ignored)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} is read, and would be lost if it were also the output; give "
                                "another name",
                                output.string()));
    }
}

void publish(const std::filesystem::path& temporary, const std::filesystem::path& path,
             bool force) {
    sync(temporary, O_RDONLY);
    const unsigned flags = force ? 0U : static_cast<unsigned>(RENAME_NOREPLACE);
    int result = ::renameat2(AT_FDCWD, temporary.c_str(), AT_FDCWD, path.c_str(), flags);
    if (result != 0 && errno == EINVAL && !force) {
        // The file system has no exclusive rename: a hard link is exclusive as well.
        result = ::link(temporary.c_str(), path.c_str());
        if (result == 0) {
            ::unlink(temporary.c_str());
        }
    }
    if (result != 0) {
        if (errno == EEXIST) {
            exists_already(path);
        }
        throw Error(ErrorKind::io, fmt::format("{}: cannot give the finished file its name: {}",
                                               path.string(), std::strerror(errno)));
    }
    sync(folder_of(path), O_RDONLY | O_DIRECTORY);
}

OutputFile::OutputFile(std::filesystem::path path, bool force,
                       const std::function<void(const std::filesystem::path& temporary)>& prepare)
    : path_(std::move(path)), temporary_(temporary_name(path_)), force_(force) {
    check_output(path_, force_);
    int flags = O_CREAT | O_EXCL;
    if (prepare) {
        try {
            prepare(temporary_);
        } catch (...) {
            ::unlink(temporary_.c_str());
            throw;
        }
        flags = 0;
    }
    fd_ = ::open(temporary_.c_str(), flags | O_WRONLY | O_CLOEXEC, 0666);
    if (fd_ < 0) {
        const int error = errno;
        ::unlink(temporary_.c_str());
        fail("create", error);
    }
}

OutputFile::~OutputFile() {
    if (fd_ >= 0) {
        ::close(fd_);
        ::unlink(temporary_.c_str());
    }
}

void OutputFile::write_at(std::uint64_t offset, std::span<const std::byte> bytes) const {
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

void OutputFile::publish_as_named() {
    publish(temporary_, path_, force_);
    ::close(fd_);
    fd_ = -1;
}

void OutputFile::fail(const char* what, int error) const {
    throw Error(ErrorKind::io,
                fmt::format("{}: cannot {}: {}", path_.string(), what, std::strerror(error)));
}

}  // namespace isonest
