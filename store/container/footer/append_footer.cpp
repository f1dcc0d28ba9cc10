#include "store/container/footer/append_footer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>

#include <isonest/error.h>

#include "store/container/footer/footer.h"

namespace isonest::detail {

void append_footer(const std::filesystem::path& file, const std::vector<std::byte>& catalogue,
                   const std::filesystem::path& shown) {
    const int fd = ::open(file.c_str(), O_WRONLY | O_CLOEXEC | O_NOFOLLOW);
    const off_t end = fd < 0 ? -1 : ::lseek(fd, 0, SEEK_END);
    bool good = end >= 0;
    if (good) {
        const std::vector<std::byte> bytes =
            bytes_behind_hdf5(static_cast<std::uint64_t>(end), catalogue);
        for (std::size_t done = 0; good && done < bytes.size();) {
            const ssize_t n = ::write(fd, bytes.data() + done, bytes.size() - done);
            good = n > 0 || (n < 0 && errno == EINTR);
            errno = n == 0 ? ENOSPC : errno;
            done += n > 0 ? static_cast<std::size_t>(n) : 0;
        }
    }
    const int error = errno;
    if (fd >= 0) {
        good = ::close(fd) == 0 && good;
    }
    if (!good) {
        throw Error(ErrorKind::io, {shown.string()},
                    fmt::format("cannot write the footer: {}", std::strerror(error)));
    }
}

}  // namespace isonest::detail
