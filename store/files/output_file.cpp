#include "store/files/output_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <optional>
#include <string_view>
#include <system_error>
#include <utility>

#include <isonest/error.h>

#include "store/files/open_file.h"

namespace isonest::detail {
namespace {

std::filesystem::path folder_of(const std::filesystem::path& path) {
    const std::filesystem::path folder = path.parent_path();
    return folder.empty() ? std::filesystem::path(".") : folder;
}

[[noreturn]] void fail_on(const std::filesystem::path& path, const char* what, int error) {
    throw Error(ErrorKind::io, {path.string()},
                fmt::format("cannot {}: {}", what, std::strerror(error)));
}

class Descriptor {
  public:
    Descriptor(const std::filesystem::path& path, int flags)
        : path_(path), fd_(::open(path.c_str(), flags | O_CLOEXEC)) {
        if (fd_ < 0) {
            fail_on(path_, "write to disk", errno);
        }
    }
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;
    ~Descriptor() { ::close(fd_); }
    [[nodiscard]] int get() const { return fd_; }
    void sync() const {
        if (::fsync(fd_) != 0) {
            fail_on(path_, "write to disk", errno);
        }
    }

  private:
    const std::filesystem::path& path_;
    int fd_;
};

/// Status of what has this name, without following links; nullopt if the name is free.
std::optional<struct stat> status_of(const std::filesystem::path& path) {
    struct stat status {};
    if (::lstat(path.c_str(), &status) == 0) {
        return status;
    }
    if (errno != ENOENT) {
        fail_on(path, "look at it", errno);
    }
    return std::nullopt;
}

constexpr std::string_view kMark = ".partial-";
constexpr mode_t kPermissions = S_IRWXU | S_IRWXG | S_IRWXO;

[[noreturn]] void exists_already(const std::filesystem::path& path) {
    throw Error(ErrorKind::invalid_argument, {path.string()}, "exists",
                {{RemedyKind::replace_existing}, {RemedyKind::other_name}});
}

[[noreturn]] void is_folder(const std::filesystem::path& path) {
    throw Error(ErrorKind::invalid_argument, {path.string()}, "is a folder; give a file name");
}

[[noreturn]] void never_replaced(const std::filesystem::path& path, const std::string& what) {
    throw Error(ErrorKind::invalid_argument, {path.string()},
                fmt::format("is {}; only regular files can be replaced", what),
                {{RemedyKind::other_name}});
}

void require_regular(const std::filesystem::path& path, mode_t mode) {
    std::error_code ignored;
    if (S_ISREG(mode)) {
        return;
    }
    if (S_ISDIR(mode)) {
        is_folder(path);
    }
    if (S_ISLNK(mode)) {
        const std::string to = std::filesystem::read_symlink(path, ignored).string();
        never_replaced(path, std::filesystem::exists(path, ignored)
                                 ? fmt::format("a link to {}", to)
                                 : fmt::format("a broken link to {}", to));
    }
    never_replaced(path, S_ISFIFO(mode) ? "a FIFO" : S_ISSOCK(mode) ? "a socket" : "a device");
}

/// Copies the permissions of `old`, and its owner and group if that is allowed.
void keep_permissions(int fd, const std::filesystem::path& path, const struct stat& old) {
    struct stat mine {};
    if (::fstat(fd, &mine) != 0) {
        fail_on(path, "inspect it", errno);
    }
    mode_t mode = old.st_mode & kPermissions;
    if (mine.st_gid != old.st_gid && ::fchown(fd, static_cast<uid_t>(-1), old.st_gid) != 0) {
        // Permissions of the old group must not apply to another group.
        mode &= ~static_cast<mode_t>(S_IRWXG) | ((mode & S_IRWXO) << 3U);
    }
    if ((mine.st_mode & kPermissions) != mode && ::fchmod(fd, mode) != 0 && errno != EPERM &&
        errno != ENOTSUP && errno != ENOSYS) {  // file systems without permissions
        fail_on(path, "keep the permissions", errno);
    }
    if (mine.st_uid != old.st_uid) {
        [[maybe_unused]] const int allowed = ::fchown(fd, old.st_uid, static_cast<gid_t>(-1));
    }
}

/// File systems permit names of up to 255 bytes, and the temporary name is longer. Long names are
/// replaced by their beginning and a hash.
std::string shortened(const std::string& name) {
    constexpr std::size_t kMax = 200;
    constexpr std::size_t kKept = 180;
    if (name.size() <= kMax) {
        return name;
    }
    std::uint64_t number = 0xcbf29ce484222325U;  // FNV-1a
    for (const char c : name) {
        number = (number ^ static_cast<unsigned char>(c)) * 0x100000001b3U;
    }
    return fmt::format("{}~{:016x}", name.substr(0, kKept), number);
}

}  // namespace

std::filesystem::path temporary_prefix(const std::filesystem::path& path) {
    const std::string name = path.filename().string();
    const bool is_temporary = name.starts_with('.') && name.find(kMark) != std::string::npos;
    return folder_of(path) / fmt::format("{}{}{}", is_temporary ? "" : ".",
                                         is_temporary ? name : shortened(name), kMark);
}

std::string lower_extension(const std::filesystem::path& path) {
    std::string extension = path.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return extension;
}

std::filesystem::path temporary_name(const std::filesystem::path& path) {
    // In containers, process ids are reused: files left by another run must not be overwritten.
    const std::string first = (temporary_prefix(path) += std::to_string(::getpid())).string();
    std::string name = first;
    std::error_code ignored;
    for (int i = 2; std::filesystem::exists(std::filesystem::symlink_status(name, ignored)); ++i) {
        name = fmt::format("{}-{}", first, i);
    }
    return name;
}

void check_output(const std::filesystem::path& path, bool force,
                  const std::vector<std::filesystem::path>& inputs) {
    std::error_code ignored;
    if (path.filename().empty()) {
        is_folder(path);
    }
    const std::filesystem::file_status folder = std::filesystem::status(folder_of(path), ignored);
    if (folder.type() == std::filesystem::file_type::none) {
        fail_on(path, "look at its folder", ignored.value());
    }
    if (!std::filesystem::is_directory(folder)) {
        throw Error(ErrorKind::not_found, {path.string()},
                    fmt::format("there is no folder {}", folder_of(path).string()));
    }
    const std::optional<struct stat> there = status_of(path);
    if (!there) {
        return;
    }
    for (const std::filesystem::path& input : inputs) {
        if (std::filesystem::equivalent(path, input, ignored)) {
            throw Error(ErrorKind::invalid_argument, {path.string()},
                        "is an input and cannot also be the output", {{RemedyKind::other_name}});
        }
    }
    require_regular(path, there->st_mode);
    if (!force) {
        exists_already(path);
    }
}

UnfinishedFile::UnfinishedFile(std::filesystem::path output, bool force)
    : output_(std::move(output)), name_(temporary_name(output_)), force_(force) {
    check_output(output_, force_, {});
    static_cast<void>(status_of(name_));  // it may be too long even if the output's is not
}

UnfinishedFile::~UnfinishedFile() {
    if (at_end_ == AtEnd::remove) {
        ::unlink(name_.c_str());
    }
}

void UnfinishedFile::created() const {
    const std::optional<struct stat> old = status_of(output_);
    const std::optional<struct stat> mine = status_of(name_);
    if (old && mine && S_ISREG(old->st_mode)) {
        const mode_t mode = (mine->st_mode & old->st_mode & kPermissions) | S_IRUSR | S_IWUSR;
        // Without permissions in the file system, there is nothing to restrict.
        [[maybe_unused]] const int restricted = ::chmod(name_.c_str(), mode);
    }
}

void UnfinishedFile::publish() {
    {
        const Descriptor file(name_, O_RDONLY);
        const std::optional<struct stat> old = force_ ? status_of(output_) : std::nullopt;
        if (old) {
            require_regular(output_, old->st_mode);
            keep_permissions(file.get(), output_, *old);
        }
        file.sync();
    }
    const unsigned flags = force_ ? 0U : static_cast<unsigned>(RENAME_NOREPLACE);
    int result = ::renameat2(AT_FDCWD, name_.c_str(), AT_FDCWD, output_.c_str(), flags);
    if (result != 0 && errno == EINVAL && !force_) {
        // The file system has no exclusive rename, but creating a hard link is exclusive as well.
        result = ::link(name_.c_str(), output_.c_str());
        if (result == 0) {
            ::unlink(name_.c_str());
        }
    }
    if (result != 0) {
        if (errno == EEXIST) {
            exists_already(output_);
        }
        fail_on(output_, "rename the finished file", errno);
    }
    at_end_ = AtEnd::nothing;
    const std::filesystem::path folder = folder_of(output_);
    Descriptor(folder, O_RDONLY | O_DIRECTORY).sync();
}

OutputFile::OutputFile(std::filesystem::path path, bool force,
                       const std::function<void(const std::filesystem::path& temporary)>& prepare)
    : path_(std::move(path)), unfinished_(path_, force) {
    if (prepare) {
        prepare(unfinished_.name());
    }
    const int flags = prepare ? O_NOFOLLOW : O_CREAT | O_EXCL;
    fd_ = ::open(unfinished_.name().c_str(), flags | O_WRONLY | O_CLOEXEC, 0666);
    if (fd_ < 0) {
        fail_on(path_, "create", errno);
    }
    unfinished_.created();
}

OutputFile::~OutputFile() {
    if (fd_ >= 0) {
        ::close(fd_);
    }
}

void OutputFile::write_at(std::uint64_t offset, std::span<const std::byte> bytes) const {
    while (!bytes.empty()) {
        const ssize_t n = ::pwrite(fd_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n <= 0) {
            fail_on(path_, "write", n == 0 ? ENOSPC : errno);
        }
        early_.wrote(fd_, static_cast<std::uint64_t>(n));
        offset += static_cast<std::uint64_t>(n);
        bytes = bytes.subspan(static_cast<std::size_t>(n));
    }
}

const std::filesystem::path& OutputFile::share() {
    const int shared = open_shared(unfinished_.name().c_str(), O_WRONLY | O_CLOEXEC | O_NOFOLLOW);
    if (shared < 0) {
        fail_on(path_, "open", errno);
    }
    // Everything written so far must be on disk before others write beside it.
    int error = ::fsync(fd_) == 0 ? 0 : errno;
    if (::close(fd_) != 0 && error == 0) {
        error = errno;
    }
    fd_ = shared;
    if (error != 0) {
        fail_on(path_, "write to disk", error);
    }
    return unfinished_.name();
}

void OutputFile::publish_as_named() {
    unfinished_.publish();
    ::close(fd_);
    fd_ = -1;
}

namespace {

std::filesystem::path without_last_slash(std::filesystem::path path) {
    return path.has_filename() ? std::move(path) : path.parent_path();
}

[[noreturn]] void fail_with_folder(const std::filesystem::path& path, const char* what, int error) {
    throw Error(ErrorKind::io, {path.string()},
                fmt::format("cannot {}: {}", what, std::strerror(error)));
}

int rename_with(const std::filesystem::path& from, const std::filesystem::path& to,
                unsigned flags) {
    return ::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), flags) == 0 ? 0 : errno;
}

}  // namespace

OutputFolder::OutputFolder(std::filesystem::path output, bool force, MayReplace may_replace)
    : output_(without_last_slash(std::move(output))),
      force_(force),
      may_replace_(std::move(may_replace)) {
    if (!output_.has_filename() || output_.filename() == "." || output_.filename() == "..") {
        throw Error(ErrorKind::invalid_argument, {output_.string()}, "give a name for the folder",
                    {{RemedyKind::other_name}});
    }
    check();
    name_ = temporary_name(output_);
    if (::mkdir(name_.c_str(), S_IRWXU | S_IRWXG | S_IRWXO) != 0) {
        const int error = errno;
        const std::filesystem::path parent = output_.parent_path();
        if (error == ENOENT) {
            throw Error(ErrorKind::not_found, {output_.string()},
                        fmt::format("there is no folder {}", parent.string()));
        }
        fail_with_folder(output_, "create", error);
    }
}

OutputFolder::~OutputFolder() {
    if (!name_.empty()) {
        std::error_code ignored;
        std::filesystem::remove_all(name_, ignored);
    }
}

void OutputFolder::check() const {
    std::error_code error;
    const std::filesystem::file_status there = std::filesystem::symlink_status(output_, error);
    if (!std::filesystem::exists(there)) {
        return;
    }
    if (!std::filesystem::is_directory(there)) {
        throw Error(ErrorKind::invalid_argument, {output_.string()}, "exists and is not a folder",
                    {{RemedyKind::other_name}});
    }
    if (!force_) {
        throw Error(ErrorKind::invalid_argument, {output_.string()}, "exists",
                    {{RemedyKind::replace_existing}, {RemedyKind::other_name}});
    }
    may_replace_(output_);
}

void OutputFolder::require_there() const {
    std::error_code error;
    if (std::filesystem::symlink_status(name_, error).type() ==
        std::filesystem::file_type::not_found) {
        throw Error(ErrorKind::io, {output_.string()},
                    fmt::format("its unfinished folder, {}, was removed while it was filled",
                                name_.string()));
    }
}

void OutputFolder::publish() {
    check();
    int error = rename_with(name_, output_, RENAME_NOREPLACE);
    if (error == EINVAL) {
        // The file system has no exclusive rename; rename() replaces only empty folders.
        error = ::rename(name_.c_str(), output_.c_str()) == 0 ? 0 : errno;
    }
    if (error == 0) {
        name_.clear();
        return;
    }
    if ((error != EEXIST && error != ENOTEMPTY) || !force_) {
        check();  // reports a folder that has appeared or disappeared meanwhile
        require_there();
        fail_with_folder(output_, "rename the finished folder", error);
    }
    // The old folder gets the temporary name, under which the destructor removes it.
    error = rename_with(name_, output_, RENAME_EXCHANGE);
    if (error == EINVAL) {
        const std::filesystem::path old = temporary_name(output_);
        error = ::rename(output_.c_str(), old.c_str()) == 0 ? 0 : errno;
        if (error == 0 && ::rename(name_.c_str(), output_.c_str()) != 0) {
            error = errno;
            static_cast<void>(::rename(old.c_str(), output_.c_str()));
        } else if (error == 0) {
            name_ = old;
        }
    }
    if (error != 0) {
        fail_with_folder(output_, "replace", error);
    }
}

}  // namespace isonest::detail
