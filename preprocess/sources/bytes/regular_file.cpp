#include "preprocess/sources/bytes/regular_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>

#include <isonest/error.h>

namespace isonest::detail {

std::uint64_t regular_file_size(const InputFile& file) {
    if (file.is_far()) {
        return file.bytes()->size();
    }
    const std::filesystem::path& path = file.path();
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

std::string first_bytes(const InputFile& file, std::size_t count, std::uint64_t at) {
    if (file.is_far()) {
        const std::uint64_t size = file.bytes()->size();
        const HeldBytes held = file.bytes()->read(
            std::min(at, size), std::min<std::uint64_t>(count, size - std::min(at, size)));
        return {reinterpret_cast<const char*>(held.bytes().data()), held.bytes().size()};
    }
    const std::filesystem::path& path = file.path();
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

bool is_file_of_folder(const std::filesystem::directory_entry& entry) {
    using std::filesystem::file_type;
    std::error_code error;
    const file_type type = entry.status(error).type();
    const bool leads_nowhere =
        type == file_type::not_found || type == file_type::none || type == file_type::unknown;
    return type == file_type::regular || (leads_nowhere && entry.is_symlink(error));
}

}  // namespace isonest::detail
