#include "preprocess/sources/bytes/input_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <span>
#include <system_error>
#include <utility>

#include <isonest/error.h>

#include "store/container/codec.h"

namespace isonest::detail {

std::uint64_t regular_file_size(const InputFile& file) {
    if (file.is_remote()) {
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
    if (file.is_remote()) {
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

InputFile::InputFile(std::string url, std::shared_ptr<RemoteObjects> elsewhere)
    : url_(std::move(url)), elsewhere_(std::move(elsewhere)), bytes_(elsewhere_->open(url_)) {
    constexpr std::uint64_t kSample = std::uint64_t{1} << 16U;
    path_ = bytes_->name();
    const std::uint64_t size = bytes_->size();
    if (size == 0) {
        throw Error(ErrorKind::invalid_argument, {name()}, "the object is empty");
    }
    const std::uint64_t sample = std::min(size, kSample);
    std::vector<std::byte> ends;
    for (const std::uint64_t at : {std::uint64_t{0}, size - sample}) {
        const HeldBytes held = bytes_->read(at, sample);
        ends.insert(ends.end(), held.bytes().begin(), held.bytes().end());
    }
    if (!bytes_->version().empty()) {
        state_ = fmt::format("bytes {}, version {}, ends {:016x}", size, bytes_->version(),
                             checksum_of(ends));
    }
}

std::uint64_t InputFile::window() const {
    return std::min(elsewhere_->window(), bytes_->size());
}

InputFile InputFile::beside(const std::string& name) const {
    if (!is_remote()) {
        return path_.parent_path() / name;
    }
    return {url_beside(url_, name, this->name()), elsewhere_};
}

std::vector<std::filesystem::path> local_files(const std::vector<InputFile>& files) {
    std::vector<std::filesystem::path> paths;
    for (const InputFile& file : files) {
        if (!file.is_remote() && !file.empty()) {
            paths.push_back(file.path());
        }
    }
    return paths;
}

namespace {

constexpr std::size_t kSample = std::size_t{1} << 16U;

std::string state_of(const std::filesystem::path& path) {
    const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    struct stat status {};
    if (file < 0 || ::fstat(file, &status) != 0) {
        if (file >= 0) {
            ::close(file);
        }
        return "cannot be read";
    }
    const auto size = static_cast<std::uint64_t>(std::max<off_t>(status.st_size, 0));
    std::vector<std::byte> bytes(2 * kSample);
    std::size_t count = 0;
    for (const std::uint64_t at :
         {std::uint64_t{0}, size - std::min<std::uint64_t>(size, kSample)}) {
        const ssize_t n = ::pread(file, bytes.data() + count, kSample, static_cast<off_t>(at));
        count += static_cast<std::size_t>(std::max<ssize_t>(n, 0));
    }
    ::close(file);
    return fmt::format("bytes {}, time {}.{:09}, ends {:016x}", size, status.st_mtim.tv_sec,
                       status.st_mtim.tv_nsec, checksum_of(std::span(bytes).first(count)));
}

}  // namespace

std::string identity_of(const std::vector<std::filesystem::path>& files) {
    return identity_of_inputs({files.begin(), files.end()});
}

std::string identity_of_inputs(const std::vector<InputFile>& files) {
    constexpr std::size_t kOwnLine = 32;
    std::string text;
    std::string others;
    for (std::size_t i = 0; i < files.size(); ++i) {
        const bool is_remote = files[i].is_remote();
        if (is_remote && files[i].state().empty()) {
            return "";
        }
        const std::string state = is_remote ? files[i].state() : state_of(files[i].path());
        if (i < kOwnLine) {
            text += fmt::format("{} {}\n", i == 0 ? "input" : "data", state);
        } else {
            others += state + "\n";
        }
    }
    if (!others.empty()) {
        text += fmt::format("data of {} other files {:016x}\n", files.size() - kOwnLine,
                            checksum_of(std::as_bytes(std::span(others))));
    }
    return text;
}

namespace {

/// Bytes copied at a time; they are held in memory.
constexpr std::uint64_t kCopied = std::uint64_t{1} << 20U;

}  // namespace

void ReadAhead::expect(std::vector<ByteRange> ranges) {
    const std::lock_guard lock(mutex_);
    is_told_ = true;
    expected_ = std::move(ranges);
    next_ = 0;
    begun_ = 0;
    prefetched_ = 0;
    passed_ = 0;
    max_ahead_ = window_;
    prefetch();
}

void ReadAhead::prefetch() {
    // Requests a quarter of the window at a time, so that there are few requests.
    if (prefetched_ > passed_ + max_ahead_ - max_ahead_ / 4) {
        return;
    }
    std::vector<ByteRange> batch;
    while (next_ < expected_.size() && prefetched_ < passed_ + max_ahead_) {
        const ByteRange& range = expected_[next_];
        const std::uint64_t size =
            std::min(range.size - begun_, passed_ + max_ahead_ - prefetched_);
        if (size > 0) {
            batch.push_back({range.offset + begun_, size});
        }
        prefetched_ += size;
        begun_ += size;
        if (begun_ == range.size) {
            ++next_;
            begun_ = 0;
        }
    }
    if (!batch.empty()) {
        bytes_->want(batch);
    }
}

void ReadAhead::follow(std::uint64_t at, std::uint64_t size) {
    if (at != end_of_run_) {
        run_ = 0;
        expected_.clear();
    }
    if (run_ > 0 && expected_.empty()) {
        expected_ = {{at, size_ - at}};
        next_ = 0;
        begun_ = 0;
        prefetched_ = 0;
        passed_ = 0;
    }
    run_ += size;
    end_of_run_ = at + size;
    max_ahead_ = std::min(window_, run_);
    prefetch();
}

void ReadAhead::passed(std::uint64_t size) {
    const std::lock_guard lock(mutex_);
    passed_ += size;
    prefetch();
}

void ReadAhead::read(std::uint64_t at, std::byte* dst, std::uint64_t size) {
    while (size > 0) {
        const std::uint64_t n = std::min({size, kCopied, std::max(window_, kCopied / 4)});
        if (!is_told_) {
            const std::lock_guard lock(mutex_);
            follow(at, n);
        }
        const HeldBytes held = bytes_->read(at, n);
        std::memcpy(dst, held.bytes().data(), n);
        passed(n);
        at += n;
        dst += n;
        size -= n;
    }
}

}  // namespace isonest::detail
