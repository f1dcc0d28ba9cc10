#include "store/files/output_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <system_error>
#include <utility>

#include <isonest/error.h>

#include "store/files/output_file.h"

namespace isonest::detail {
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
        throw Error(ErrorKind::invalid_argument, {output_.string()}, "is there, and no folder",
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
        // The file system has no exclusive rename; of folders, rename() replaces empty ones alone.
        error = ::rename(name_.c_str(), output_.c_str()) == 0 ? 0 : errno;
    }
    if (error == 0) {
        name_.clear();
        return;
    }
    if ((error != EEXIST && error != ENOTEMPTY) || !force_) {
        check();  // what came meanwhile, or went, is said as such
        require_there();
        fail_with_folder(output_, "give the finished folder its name", error);
    }
    // The old one gets the temporary name, by which the destructor removes it.
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
