#include "store/bytes/cache_room.h"

#include <dirent.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <ctime>
#include <memory>
#include <string_view>
#include <thread>
#include <vector>

namespace isonest::detail {
namespace {

constexpr unsigned kFolderBits = 56;  // of a number, behind those that choose the folder
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

/// f(folder's descriptor, name, status) for the regular files in a folder.
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

/// Ages in nanoseconds by their logarithm, 64 classes for each factor of 2.
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

/// Whether the file was made more than a minute ago.
bool is_old(const struct stat& status) {
    constexpr std::int64_t kMinute = 60'000'000'000;
    return clock_now() - nanoseconds(status.st_mtim) > kMinute;
}

/// Removes old ones; returns what the others take, but `own`.
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
    // Never without an end: who has the lock may have been stopped.
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
    // The new count must not be less than what the entries take. Who writes one completes a
    // temporary file, counts it, and moves it. So what is counted in `before` is complete now, and
    // is found among the temporary files, or among the entries, which come after them (or in both).
    // What is found, and counted later, is counted twice. Where the count is not known, nobody
    // adds.
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
        // All older than this class go, and as many of it as are needed.
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

}  // namespace isonest::detail
