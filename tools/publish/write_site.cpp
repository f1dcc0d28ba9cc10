#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <span>
#include <string>

#include <isonest/error.h>

#include "store/files/output_file.h"
#include "store/files/output_folder.h"
#include "tools/publish/site.h"

namespace isonest::detail::publish {
namespace {

constexpr std::size_t kPiece = std::size_t{4} << 20U;

void write_text(const std::filesystem::path& path, std::string_view text) {
    OutputFile file(path, false);
    file.write_at(0, std::as_bytes(std::span(text)));
    file.publish_as_named();
}

[[noreturn]] void fail_store(const std::filesystem::path& path, const char* what, int error) {
    throw Error(ErrorKind::io, {path.string()},
                fmt::format("cannot {}: {}", what, std::strerror(error)));
}

class Input {
  public:
    explicit Input(const std::filesystem::path& path)
        : path_(path), fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
        if (fd_ < 0) {
            fail_store(path_, "read", errno);
        }
    }
    Input(const Input&) = delete;
    Input& operator=(const Input&) = delete;
    ~Input() { ::close(fd_); }
    /// 0 at the end.
    std::size_t read(std::span<std::byte> bytes) const {
        for (;;) {
            const ssize_t n = ::read(fd_, bytes.data(), bytes.size());
            if (n >= 0) {
                return static_cast<std::size_t>(n);
            }
            if (errno != EINTR) {
                fail_store(path_, "read", errno);
            }
        }
    }

  private:
    const std::filesystem::path& path_;
    int fd_;
};

void copy_store(const SiteStore& store, const std::filesystem::path& to, Progress& progress) {
    const Input from(store.file);
    OutputFile file(to, false);
    std::vector<std::byte> piece(kPiece);
    std::uint64_t at = 0;
    while (const std::size_t size = from.read(piece)) {
        progress.check();
        file.write_at(at, std::span(piece).first(size));
        at += size;
        progress.advance(size);
    }
    if (at != store.bytes) {
        throw Error(ErrorKind::io, {store.file.string()}, "has changed while it was copied",
                    {{RemedyKind::open_again}});
    }
    file.publish_as_named();
}

void link_store(const SiteStore& store, const std::filesystem::path& to) {
    if (::linkat(AT_FDCWD, store.file.c_str(), AT_FDCWD, to.c_str(), AT_SYMLINK_FOLLOW) == 0) {
        return;
    }
    const int error = errno;
    throw Error(ErrorKind::io, {store.file.string()},
                error == EXDEV ? std::string("lies on another file system than the site, where a "
                                             "hard link does not reach")
                               : fmt::format("cannot be linked: {}", std::strerror(error)),
                {{RemedyKind::leave_out, "hard-link"}});
}

/// What is read must not be removed with the folder that is replaced.
void require_outside(const std::filesystem::path& folder, const Site& site) {
    std::error_code error;
    const std::filesystem::path whole = std::filesystem::canonical(folder, error);
    for (const SiteStore& store : site.stores) {
        std::error_code ignored;
        const std::filesystem::path file = std::filesystem::canonical(store.described_by, ignored);
        const auto [end, unused] =
            std::mismatch(whole.begin(), whole.end(), file.begin(), file.end());
        if (!error && !ignored && !store.described_by.empty() && end == whole.end()) {
            throw Error(ErrorKind::invalid_argument, {store.described_by.string()},
                        "is read, and lies in the folder that is to be replaced",
                        {{RemedyKind::other_name}});
        }
    }
}

/// Returns the names of all files.
std::vector<std::string> fill(const OutputFolder& output, const Site& site,
                              const std::vector<PageFile>& page, Progress& progress) {
    std::vector<std::string> files;
    std::uint64_t all = 0;
    bool has_stores = false;
    for (const SiteStore& store : site.stores) {
        has_stores = has_stores || !store.file.empty();
        all += store.file.empty() || site.hard_links ? 0 : store.bytes;
    }
    if (has_stores) {
        std::filesystem::create_directory(output.name() / "stores");
    }
    if (all > 0) {
        progress.begin("copying", all, "B");
    }
    for (const SiteStore& store : site.stores) {
        if (store.file.empty()) {
            continue;
        }
        files.push_back(fmt::format("stores/{}.isonest", store.name));
        if (site.hard_links) {
            link_store(store, output.name() / files.back());
        } else {
            copy_store(store, output.name() / files.back(), progress);
        }
    }
    for (const PageFile& file : page) {
        files.emplace_back(file.name);
        write_text(output.name() / file.name, file.name == "index.html"
                                                  ? site_page(file.bytes, site)
                                                  : std::string(file.bytes));
    }
    progress.check();
    files.emplace_back("site.json");
    std::sort(files.begin(), files.end());
    write_text(output.name() / "site.json", site_list(site, files));
    return files;
}

}  // namespace

std::vector<std::string> write_site(const std::filesystem::path& folder, const Site& site,
                                    const std::vector<PageFile>& page, bool force,
                                    Progress& progress) {
    OutputFolder output(folder, force, [&](const std::filesystem::path& old) {
        require_own_site(old);
        require_outside(old, site);
    });
    std::vector<std::string> files;
    try {
        files = fill(output, site, page, progress);
    } catch (...) {
        output.require_there();
        throw;
    }
    output.publish();
    return files;
}

}  // namespace isonest::detail::publish
