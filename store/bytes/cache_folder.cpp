#include "store/bytes/cache_folder.h"

#include <dirent.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <ctime>
#include <memory>
#include <random>
#include <string_view>
#include <system_error>
#include <thread>
#include <vector>

#include <isonest/error.h>

#include "store/files/open_file.h"

namespace isonest::detail {
namespace {

constexpr unsigned kFolderBits = 56;  // of a number, after those that choose the folder
constexpr unsigned kFolders = 256;
constexpr std::size_t kNameDigits = 14;

std::int64_t nanoseconds(const struct timespec& t) {
    constexpr std::int64_t kSecond = 1'000'000'000;
    return std::int64_t{t.tv_sec} * kSecond + t.tv_nsec;
}

std::int64_t clock_now() {
    struct timespec now {};
    ::clock_gettime(CLOCK_REALTIME, &now);
    return nanoseconds(now);
}

struct CloseFolder {
    void operator()(DIR* folder) const { ::closedir(folder); }
};

/// Calls f(folder's descriptor, name, status) for the regular files in a folder.
template <class F>
void each_file(int root, const char* name, const F& f) {
    const int fd = ::openat(root, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
    if (fd < 0) {
        return;
    }
    const std::unique_ptr<DIR, CloseFolder> folder(::fdopendir(fd));
    if (!folder) {
        ::close(fd);
        return;
    }
    while (const dirent* const entry = ::readdir(folder.get())) {
        struct stat status {};
        if (::fstatat(fd, entry->d_name, &status, AT_SYMLINK_NOFOLLOW) == 0 &&
            S_ISREG(status.st_mode)) {
            f(fd, entry->d_name, status);
        }
    }
}

template <class F>
void each_entry(int root, const F& f) {
    for (unsigned i = 0; i < kFolders; ++i) {
        each_file(root, fmt::format("{:02x}", i).c_str(),
                  [&](int folder, const char* name, const struct stat& status) {
                      const std::string_view digits(name);
                      if (digits.size() == kNameDigits &&
                          digits.find_first_not_of("0123456789abcdef") == std::string_view::npos) {
                          f(folder, name, status);
                      }
                  });
    }
}

/// Classes of ages in nanoseconds on a logarithmic scale, 64 classes per factor of 2.
constexpr unsigned kFineBits = 6;
constexpr std::size_t kAgeClasses = (64 - kFineBits + 1) << kFineBits;

std::size_t age_class(std::int64_t age) {
    const auto a = static_cast<std::uint64_t>(std::max<std::int64_t>(age, 0));
    const auto width = static_cast<unsigned>(std::bit_width(a));
    if (width <= kFineBits) {
        return a;
    }
    const unsigned shift = width - kFineBits - 1;
    return ((std::size_t{shift} + 1) << kFineBits) + ((a >> shift) & ((1U << kFineBits) - 1));
}

/// Whether the file was modified more than a minute ago.
bool is_old(const struct stat& status) {
    constexpr std::int64_t kMinute = 60'000'000'000;
    return clock_now() - nanoseconds(status.st_mtim) > kMinute;
}

/// Removes old temporary files; returns the disk space of the others except `own`.
std::uint64_t bytes_of_temporaries(int root, std::string_view own) {
    std::uint64_t sum = 0;
    each_file(root, kTemporariesOfCache,
              [&](int folder, const char* name, const struct stat& status) {
                  if (is_old(status)) {
                      ::unlinkat(folder, name, 0);
                  } else if (own != name) {
                      sum += cache_entry_takes(static_cast<std::uint64_t>(status.st_size));
                  }
              });
    return sum;
}

int open_for_lock(int root, const char* name) {
    return ::openat(root, name, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, S_IRUSR | S_IWUSR);
}

}  // namespace

std::string cache_entry_name(std::uint64_t number) {
    return fmt::format("{:02x}/{:014x}", number >> kFolderBits,
                       number & ((std::uint64_t{1} << kFolderBits) - 1));
}

std::uint64_t cache_entry_takes(std::uint64_t bytes) {
    constexpr std::uint64_t kDiskBlock = 4096;
    return (bytes + kDiskBlock - 1) / kDiskBlock * kDiskBlock;
}

CacheCount::CacheCount(int root) : file_(open_for_lock(root, "bytes")) {
    if (file_.get() < 0) {
        error_ = errno;
        return;
    }
    // Bounded, because the process that has the lock may be suspended.
    constexpr std::chrono::milliseconds kLongest(100);
    constexpr std::chrono::microseconds kWait(100);
    const auto until = std::chrono::steady_clock::now() + kLongest;
    do {
        if (::flock(file_.get(), LOCK_EX | LOCK_NB) == 0) {
            is_locked_ = true;
            return;
        }
        if (errno != EWOULDBLOCK && errno != EINTR) {
            error_ = errno;
            return;
        }
        std::this_thread::sleep_for(kWait);
    } while (std::chrono::steady_clock::now() < until);
}

std::optional<std::uint64_t> CacheCount::get() const {
    std::array<std::uint64_t, 2> stored{};
    if (!is_locked_ || ::pread(file_.get(), stored.data(), sizeof(stored), 0) != sizeof(stored) ||
        stored[0] != ~stored[1]) {
        return std::nullopt;
    }
    return stored[0];
}

int CacheCount::set(std::uint64_t bytes) const {
    const std::array<std::uint64_t, 2> stored{bytes, ~bytes};
    const ssize_t n = ::pwrite(file_.get(), stored.data(), sizeof(stored), 0);
    return n == sizeof(stored) ? 0 : n < 0 ? errno : ENOSPC;
}

int make_cache_room(int root, std::uint64_t most, std::string_view own) {
    const FileDescriptor lock(open_for_lock(root, "removing"));
    if (lock.get() < 0 || ::flock(lock.get(), LOCK_EX | LOCK_NB) != 0) {
        return errno == EWOULDBLOCK || errno == EINTR ? 0 : errno;
    }
    std::optional<std::uint64_t> before;
    if (const CacheCount count(root); count.is_locked()) {
        before = count.get();
    } else {
        return count.error();
    }
    // The new count must not be less than the size of the entries. A writer completes a temporary
    // file, counts it, and then renames it. So everything counted in `before` is complete now, and
    // is found among the temporary files, or later among the entries (or in both). Files that are
    // found here but counted afterwards are counted twice. While the count is unknown, nobody adds
    // entries.
    std::uint64_t sum = bytes_of_temporaries(root, own);
    std::vector<std::uint64_t> of_age(kAgeClasses);
    const std::int64_t now = clock_now();
    const auto class_of = [&](const struct stat& status) {
        return age_class(now - nanoseconds(status.st_mtim));
    };
    const auto bytes_of = [](const struct stat& status) {
        return cache_entry_takes(static_cast<std::uint64_t>(status.st_size));
    };
    each_entry(root, [&](int /*folder*/, const char* /*name*/, const struct stat& status) {
        of_age[class_of(status)] += bytes_of(status);
        sum += bytes_of(status);
    });
    if (sum > most) {
        // Remove everything older than this class, and as many of this class as needed.
        std::uint64_t excess = sum - most;
        std::size_t last = kAgeClasses - 1;
        while (last > 0 && of_age[last] < excess) {
            excess -= of_age[last];
            --last;
        }
        each_entry(root, [&](int folder, const char* name, const struct stat& status) {
            const std::size_t age = class_of(status);
            if (age < last || (age == last && excess == 0) || ::unlinkat(folder, name, 0) != 0) {
                return;
            }
            sum -= std::min(sum, bytes_of(status));
            if (age == last) {
                excess -= std::min(excess, bytes_of(status));
            }
        });
    }
    CacheCount count(root);
    if (!count.is_locked()) {
        return count.error();
    }
    const auto after = count.get();
    return count.set(before && after ? *after - std::min(*before, *after) + sum : sum);
}

void remove_old_temporaries(int root) {
    static_cast<void>(bytes_of_temporaries(root, {}));
}

namespace {

constexpr mode_t kOwnFolder = S_IRWXU;
constexpr mode_t kOwnFile = S_IRUSR | S_IWUSR;

bool make_folder_below(int root, const char* name) {
    return ::mkdirat(root, name, kOwnFolder) == 0 || errno == EEXIST;
}

/// Returns 0 or the error code.
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

CacheFolder::CacheFolder(const std::filesystem::path& folder, std::uint64_t max_bytes)
    : folder_(folder), max_(max_bytes) {
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
    // Another user could insert bytes of their choice.
    if (status.st_uid != ::geteuid()) {
        turn_off(Off::all, "the folder isonest-cache-1 in it belongs to another user");
        return;
    }
    if ((status.st_mode & (S_IRWXG | S_IRWXO)) != 0) {
        turn_off(Off::all,
                 "other users can read or change the folder isonest-cache-1 in it; run chmod 700 "
                 "on that folder");
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
    // If this is not allowed, the order of use is the order of writing.
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
    if (!writes_ || takes > max_) {
        return;
    }
    const std::string temporary = temporary_prefix_ + std::to_string(temporaries_++);
    if (!write_temporary(temporary, bytes)) {
        return;
    }
    // It is counted only when it is complete: make_cache_room() relies on that.
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
        // Still missing: this process was suspended for so long that the temporary file was
        // removed.
        error = rename() || errno == ENOENT ? 0 : errno;
    }
    if (error != 0) {
        ::unlinkat(root_, temporary.c_str(), 0);
        turn_off(Off::writing, error);
    }
}

/// If the count is invalid, room is missing; it is unknown while another process holds the count.
CacheFolder::Room CacheFolder::take_room(std::uint64_t bytes) {
    const CacheCount count(root_);
    int error = count.error();
    if (count.is_locked()) {
        const auto now = count.get();
        if (!now || *now > max_ || bytes > max_ - *now) {
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
    constexpr std::uint64_t kFreed = 10;  // a tenth, so that it is not repeated immediately
    const int error = make_cache_room(root_, std::min(max_ - max_ / kFreed, max_ - bytes),
                                      std::filesystem::path(temporary).filename().native());
    if (error != 0) {
        turn_off(Off::writing, error);
    }
}

}  // namespace isonest::detail
