#include "store/bytes/cache_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <random>
#include <system_error>

#include <isonest/error.h>

#include "store/bytes/cache_room.h"
#include "store/files/file_descriptor.h"

namespace isonest::detail {
namespace {

constexpr mode_t kOwnFolder = S_IRWXU;
constexpr mode_t kOwnFile = S_IRUSR | S_IWUSR;

bool make_folder_below(int root, const char* name) {
    return ::mkdirat(root, name, kOwnFolder) == 0 || errno == EEXIST;
}

/// Returns 0, or the error.
int write_all(int fd, std::span<const std::byte> bytes) {
    while (!bytes.empty()) {
        const ssize_t n = ::write(fd, bytes.data(), bytes.size());
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n <= 0) {
            return n == 0 ? ENOSPC : errno;
        }
        bytes = bytes.subspan(static_cast<std::size_t>(n));
    }
    return 0;
}

}  // namespace

CacheFolder::CacheFolder(const std::filesystem::path& folder, std::uint64_t most_bytes)
    : folder_(folder), most_(most_bytes) {
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error) {
        throw Error(error == std::errc::not_a_directory || error == std::errc::file_exists
                        ? ErrorKind::invalid_argument
                        : ErrorKind::io,
                    {folder.string()},
                    fmt::format("cannot make this folder for the cache: {}", error.message()),
                    {{RemedyKind::other_name}});
    }
    const std::string below = (folder / "isonest-cache-1").string();
    if (::mkdir(below.c_str(), kOwnFolder) != 0 && errno != EEXIST) {
        turn_off(Off::all, errno);
        return;
    }
    root_ = ::open(below.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
    if (root_ < 0) {
        turn_off(Off::all, errno);
        return;
    }
    struct stat status {};
    if (::fstat(root_, &status) != 0) {
        turn_off(Off::all, errno);
        return;
    }
    // Others could give it bytes of their own choice.
    if (status.st_uid != ::geteuid()) {
        turn_off(Off::all, "the folder isonest-cache-1 in it belongs to another user");
        return;
    }
    if ((status.st_mode & (S_IRWXG | S_IRWXO)) != 0) {
        turn_off(Off::all,
                 "other users may look into the folder isonest-cache-1 in it, or change it "
                 "(chmod 700 ends that)");
        return;
    }
    if (!make_folder_below(root_, kTemporariesOfCache)) {
        turn_off(Off::writing, errno);
    }
    std::random_device random;
    temporary_prefix_ =
        fmt::format("{}/{:x}-{:08x}{:08x}-", kTemporariesOfCache, ::getpid(), random(), random());
    remove_old_temporaries(root_);
}

CacheFolder::~CacheFolder() {
    if (root_ >= 0) {
        ::close(root_);
    }
}

std::string CacheFolder::warning() const {
    const std::lock_guard lock(mutex_);
    return warning_;
}

void CacheFolder::turn_off(Off what, int error) {
    turn_off(what, std::strerror(error));
}

void CacheFolder::turn_off(Off what, const std::string& why) {
    const std::lock_guard lock(mutex_);
    writes_ = false;
    reads_ = reads_ && what == Off::writing;
    if (warning_.empty()) {
        warning_ = fmt::format("{}: {}: {}", folder_.string(),
                               what == Off::all ? "the cache in this folder is not used"
                                                : "nothing more is kept in this cache",
                               why);
    }
}

std::optional<std::vector<std::byte>> CacheFolder::read(std::uint64_t number, std::size_t most) {
    if (!reads_) {
        return std::nullopt;
    }
    const FileDescriptor file(::openat(root_, cache_entry_name(number).c_str(),
                                       O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
    struct stat status {};
    if (file.get() < 0 || ::fstat(file.get(), &status) != 0) {
        if (errno != ENOENT) {
            turn_off(Off::all, errno);
        }
        return std::nullopt;
    }
    if (!S_ISREG(status.st_mode) || static_cast<std::uint64_t>(status.st_size) > most) {
        return std::vector<std::byte>();
    }
    std::vector<std::byte> bytes(static_cast<std::size_t>(status.st_size));
    std::size_t got = 0;
    while (got < bytes.size()) {
        const ssize_t n = ::read(file.get(), bytes.data() + got, bytes.size() - got);
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n < 0) {
            turn_off(Off::all, errno);
            return std::nullopt;
        }
        if (n == 0) {
            break;
        }
        got += static_cast<std::size_t>(n);
    }
    bytes.resize(got);
    // Where this is not allowed, the order of use is that of writing.
    ::futimens(file.get(), nullptr);
    return bytes;
}

void CacheFolder::remove(std::uint64_t number) {
    if (writes_) {
        ::unlinkat(root_, cache_entry_name(number).c_str(), 0);
    }
}

void CacheFolder::write(std::uint64_t number, std::span<const std::byte> bytes) {
    const std::uint64_t takes = cache_entry_takes(bytes.size());
    if (!writes_ || takes > most_) {
        return;
    }
    const std::string temporary = temporary_prefix_ + std::to_string(temporaries_++);
    if (!write_temporary(temporary, bytes)) {
        return;
    }
    // It is counted when all of it is there: make_cache_room() relies on that.
    Room room = Room::unknown;
    {
        const std::lock_guard lock(counting_);
        room = take_room(takes);
        if (room == Room::missing) {
            make_room(takes, temporary);
            room = take_room(takes);
        }
    }
    if (room == Room::taken) {
        publish(temporary, number);
    } else {
        ::unlinkat(root_, temporary.c_str(), 0);
    }
}

bool CacheFolder::write_temporary(const std::string& name, std::span<const std::byte> bytes) {
    constexpr int kHow = O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW;
    int fd = ::openat(root_, name.c_str(), kHow, kOwnFile);
    if (fd < 0 && errno == ENOENT && make_folder_below(root_, kTemporariesOfCache)) {
        fd = ::openat(root_, name.c_str(), kHow, kOwnFile);
    }
    if (fd < 0) {
        turn_off(Off::writing, errno);
        return false;
    }
    int error = write_all(fd, bytes);
    if (::close(fd) != 0 && error == 0) {
        error = errno;
    }
    if (error != 0) {
        ::unlinkat(root_, name.c_str(), 0);
        turn_off(Off::writing, error);
    }
    return error == 0;
}

void CacheFolder::publish(const std::string& temporary, std::uint64_t number) {
    const std::string entry = cache_entry_name(number);
    const auto rename = [&] {
        return ::renameat(root_, temporary.c_str(), root_, entry.c_str()) == 0;
    };
    if (rename()) {
        return;
    }
    int error = errno;
    if (error == ENOENT && make_folder_below(root_, entry.substr(0, entry.find('/')).c_str())) {
        // Still missing: this process stood still for so long that the temporary file was removed.
        error = rename() || errno == ENOENT ? 0 : errno;
    }
    if (error != 0) {
        ::unlinkat(root_, temporary.c_str(), 0);
        turn_off(Off::writing, error);
    }
}

/// Of a count that is not known, room is missing; it is unknown while somebody else has the count.
CacheFolder::Room CacheFolder::take_room(std::uint64_t bytes) {
    const CacheCount count(root_);
    int error = count.error();
    if (count.is_locked()) {
        const auto now = count.get();
        if (!now || *now > most_ || bytes > most_ - *now) {
            return Room::missing;
        }
        error = count.set(*now + bytes);
        if (error == 0) {
            return Room::taken;
        }
    }
    if (error != 0) {
        turn_off(Off::writing, error);
    }
    return Room::unknown;
}

void CacheFolder::make_room(std::uint64_t bytes, const std::string& temporary) {
    constexpr std::uint64_t kFreed = 10;  // a tenth, so that it is not done again at once
    const int error = make_cache_room(root_, std::min(most_ - most_ / kFreed, most_ - bytes),
                                      std::filesystem::path(temporary).filename().native());
    if (error != 0) {
        turn_off(Off::writing, error);
    }
}

}  // namespace isonest::detail
