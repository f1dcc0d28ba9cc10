#include "store/files/scratch_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <new>
#include <string>
#include <system_error>
#include <utility>

#include <isonest/error.h>

#include "store/files/open_file.h"

namespace isonest::detail {
namespace {

[[noreturn]] void fail(const std::filesystem::path& folder, const char* what, int error) {
    throw Error(ErrorKind::io, {folder.string()},
                fmt::format("temporary space: {}: {}", what, std::strerror(error)),
                {{RemedyKind::free_space}});
}

}  // namespace

std::filesystem::path temporary_folder() {
    std::error_code error;
    std::filesystem::path folder = std::filesystem::temp_directory_path(error);
    if (error) {
        const char* const named = std::getenv("TMPDIR");
        throw Error(ErrorKind::io, {named == nullptr ? "/tmp" : named},
                    fmt::format("temporary space: {}", error == std::errc::not_a_directory
                                                           ? "there is no such folder"
                                                           : error.message()),
                    {{RemedyKind::set_variable, "TMPDIR=FOLDER"}});
    }
    return folder;
}

void ScratchMeter::add(std::uint64_t bytes) {
    const std::uint64_t now = now_ += bytes;
    std::uint64_t peak = peak_;
    while (now > peak && !peak_.compare_exchange_weak(peak, now)) {
    }
}

ScratchFolder ScratchFolder::metered(const std::filesystem::path& path) {
    return {path.empty() ? temporary_folder() : path, std::make_shared<ScratchMeter>()};
}

ScratchFile::ScratchFile(const ScratchFolder& folder)
    : folder_(folder.path().empty() ? std::filesystem::path(".") : folder.path()),
      meter_(folder.meter()) {
    fd_ = ::open(folder_.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, S_IRUSR | S_IWUSR);
    if (fd_ < 0) {
        std::string name = (folder_ / fmt::format("{}{}-XXXXXX", kPrefix, ::getpid())).string();
        fd_ = ::mkostemp(name.data(), O_CLOEXEC);
        if (fd_ < 0) {
            fail(folder_, "cannot create a file", errno);
        }
        ::unlink(name.c_str());
    }
}

ScratchFile ScratchFile::named(const std::filesystem::path& file) {
    const std::filesystem::path folder = file.parent_path().empty() ? "." : file.parent_path();
    ::unlink(file.c_str());
    const int fd = ::open(file.c_str(), O_CREAT | O_EXCL | O_RDWR | O_CLOEXEC, S_IRUSR | S_IWUSR);
    if (fd < 0) {
        fail(folder, "cannot create a file", errno);
    }
    return {fd, folder, file};
}

void ScratchFile::take(ScratchFile& other) noexcept {
    fd_ = std::exchange(other.fd_, -1);
    folder_ = std::move(other.folder_);
    meter_ = std::move(other.meter_);
    end_ = other.end_.exchange(0);
    counted_ = other.counted_.exchange(0);
    name_ = std::exchange(other.name_, {});
    map_ = std::exchange(other.map_, nullptr);
    mapped_ = std::exchange(other.mapped_, 0);
}

ScratchFile::ScratchFile(ScratchFile&& other) noexcept {
    take(other);
}

ScratchFile& ScratchFile::operator=(ScratchFile&& other) noexcept {
    if (this != &other) {
        close();
        take(other);
    }
    return *this;
}

ScratchFile::~ScratchFile() {
    close();
}

void ScratchFile::close() {
    unmap();
    if (!name_.empty()) {
        ::unlink(name_.c_str());
    }
    if (fd_ >= 0) {
        ::close(fd_);
    }
    uncount(counted_);
}

/// Extends the counted size of the file to `end`.
void ScratchFile::count_to(std::uint64_t end) {
    std::uint64_t before = end_;
    while (end > before) {
        if (end_.compare_exchange_weak(before, end)) {
            counted_ += end - before;
            if (meter_) {
                meter_->add(end - before);
            }
            return;
        }
    }
}

void ScratchFile::uncount(std::uint64_t bytes) const {
    counted_ -= bytes;
    if (meter_) {
        meter_->remove(bytes);
    }
}

void ScratchFile::lock() const {
    // Other errors: the file system has no locks, also not for other processes.
    while (::flock(fd_, LOCK_EX) != 0 && errno == EINTR) {
    }
}

void ScratchFile::unmap() {
    if (map_ != nullptr) {
        ::munmap(map_, mapped_);
    }
    map_ = nullptr;
    mapped_ = 0;
}

void ScratchFile::write_at(std::uint64_t offset, std::span<const std::byte> bytes) {
    count_to(offset + bytes.size());
    while (!bytes.empty()) {
        const ssize_t n = ::pwrite(fd_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n <= 0) {
            fail(folder_, "cannot write", n == 0 ? ENOSPC : errno);
        }
        bytes = bytes.subspan(static_cast<std::size_t>(n));
        offset += static_cast<std::uint64_t>(n);
    }
}

void ScratchFile::read_at(std::uint64_t offset, std::span<std::byte> bytes) const {
    if (!pread_whole(fd_, offset, bytes)) {
        fail(folder_, "cannot read", errno == 0 ? EIO : errno);
    }
}

void ScratchFile::reserve(std::uint64_t bytes) {
    struct stat status {};
    if (::fstat(fd_, &status) != 0) {
        fail(folder_, "cannot inspect", errno);
    }
    // Also fills holes: writing to a hole on a full disk would be a fault.
    const int error = ::posix_fallocate(fd_, 0, static_cast<off_t>(bytes));
    if (error != 0) {
        fail(folder_, fmt::format("cannot reserve {} bytes", bytes).c_str(), error);
    }
    count_to(bytes);
}

std::span<std::byte> ScratchFile::map(std::uint64_t bytes) {
    unmap();
    if (bytes == 0) {
        return {};
    }
    reserve(bytes);
    return map_reserved(bytes);
}

std::span<std::byte> ScratchFile::map_reserved(std::uint64_t bytes) {
    void* const p = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd_, 0);
    if (p == MAP_FAILED) {
        fail(folder_, "cannot map", errno);
    }
    map_ = static_cast<std::byte*>(p);
    mapped_ = bytes;
    return {map_, bytes};
}

std::span<std::byte> ScratchFile::map_hole(std::uint64_t bytes) {
    unmap();
    if (bytes == 0) {
        return {};
    }
    if (::ftruncate(fd_, static_cast<off_t>(bytes)) != 0) {
        fail(folder_, "cannot lengthen", errno);
    }
    return map_reserved(bytes);
}

void ScratchFile::fill_hole(std::uint64_t offset, std::uint64_t bytes) const {
    int error = bytes == 0 ? 0 : EINTR;
    while (error == EINTR) {  // some file systems abort on a signal
        error = ::posix_fallocate(fd_, static_cast<off_t>(offset), static_cast<off_t>(bytes));
    }
    if (error != 0) {
        fail(folder_, fmt::format("cannot reserve {} bytes", bytes).c_str(), error);
    }
}

void ScratchFile::map_at(std::byte* address, std::uint64_t bytes) {
    reserve(bytes);
    if (::mmap(address, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_FIXED, fd_, 0) ==
        MAP_FAILED) {
        fail(folder_, "cannot map", errno);
    }
}

void ScratchFile::clear() {
    unmap();
    if (::ftruncate(fd_, 0) != 0) {
        fail(folder_, "cannot shorten", errno);
    }
    end_ = 0;
    uncount(counted_);
}

void ScratchFile::release(std::uint64_t offset, std::uint64_t bytes) const {
    // If this is not supported, the space is in use until the end; no other harm.
    if (::fallocate(fd_, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, static_cast<off_t>(offset),
                    static_cast<off_t>(bytes)) == 0) {
        uncount(bytes);
    }
}

namespace {

/// Number of pieces of one size before the size doubles.
constexpr std::uint64_t kOfASize = 8;
/// Bytes of the first piece; a multiple of the page size.
constexpr std::uint64_t kFirst = std::uint64_t{1} << 18U;

/// Position of a piece in the whole.
struct Place {
    std::uint64_t number;
    std::uint64_t begin;
    std::uint64_t size;
};

Place place_of(std::uint64_t offset) {
    // The pieces of 2^k times the first size start at kOfASize * (2^k - 1) times the first size.
    constexpr std::uint64_t kGroup = kOfASize * kFirst;
    const auto k = static_cast<std::uint64_t>(std::bit_width((offset / kGroup + 1) / 2));
    const std::uint64_t group = kGroup * ((std::uint64_t{1} << k) - 1);
    const std::uint64_t size = kFirst << k;
    const std::uint64_t in_group = (offset - group) / size;
    return {k * kOfASize + in_group, group + in_group * size, size};
}

void* mapped_nowhere(void* at, std::uint64_t bytes) {
    const int fixed = at != nullptr ? MAP_FIXED : 0;
    void* const p =
        ::mmap(at, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE | fixed, -1, 0);
    if (p == MAP_FAILED) {
        throw std::bad_alloc();
    }
    return p;
}

}  // namespace

template <class F>
void PiecedFile::each_piece(std::uint64_t offset, std::uint64_t bytes, const F& f) {
    while (bytes > 0) {
        const Place at = place_of(offset);
        const std::uint64_t here = std::min(bytes, at.begin + at.size - offset);
        f(at, offset - at.begin, here);
        offset += here;
        bytes -= here;
    }
}

PiecedFile::PiecedFile(PiecedFile&& other) noexcept
    : folder_(std::move(other.folder_)),
      pieces_(std::move(other.pieces_)),
      map_(std::exchange(other.map_, nullptr)),
      mapped_(std::exchange(other.mapped_, 0)) {}

PiecedFile::Piece& PiecedFile::piece(std::size_t number) {
    const std::lock_guard lock(mutex_);
    if (pieces_.size() <= number) {
        pieces_.resize(number + 1);
    }
    if (!pieces_[number]) {
        pieces_[number] = std::make_unique<Piece>(folder_);
    }
    return *pieces_[number];
}

void PiecedFile::write_at(std::uint64_t offset, std::span<const std::byte> bytes) {
    each_piece(offset, bytes.size(),
               [&](const Place& at, std::uint64_t begin, std::uint64_t count) {
                   piece(at.number).file.write_at(begin, bytes.first(count));
                   bytes = bytes.subspan(count);
               });
}

std::span<std::byte> PiecedFile::map(std::uint64_t bytes) {
    unmap();
    if (bytes == 0) {
        return {};
    }
    map_ = static_cast<std::byte*>(mapped_nowhere(nullptr, bytes));
    mapped_ = bytes;
    each_piece(0, bytes, [&](const Place& at, std::uint64_t /*begin*/, std::uint64_t count) {
        piece(at.number).file.map_at(map_ + at.begin, count);
    });
    return {map_, bytes};
}

void PiecedFile::release(std::uint64_t offset, std::uint64_t bytes) {
    each_piece(offset, bytes, [&](const Place& at, std::uint64_t /*begin*/, std::uint64_t count) {
        Piece& released = piece(at.number);
        const std::uint64_t size = std::min(at.size, mapped_ - at.begin);
        // Only the thread that completes it closes the piece.
        const std::uint64_t so_far = released.released.fetch_add(count) + count;
        if (so_far == size) {
            mapped_nowhere(map_ + at.begin, size);
            const std::lock_guard lock(mutex_);
            pieces_[at.number].reset();
        }
    });
}

void PiecedFile::clear() {
    unmap();
    pieces_.clear();
}

void PiecedFile::unmap() {
    if (map_ != nullptr) {
        ::munmap(map_, mapped_);
    }
    map_ = nullptr;
    mapped_ = 0;
}

}  // namespace isonest::detail
