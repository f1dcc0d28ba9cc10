// What comes from a pipe, as a file.
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/types.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <optional>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/open_volume.h>

#include "preprocess/sources/hdf5/hdf5_format.h"
#include "preprocess/sources/wrapping/described_source.h"
#include "store/files/scratch_file.h"

namespace isonest {
using namespace detail;
namespace {

constexpr const char* kName = "standard input";

/// A source that reads the copy, and keeps it as long as it lives.
class StreamedSource : public DescribedSource {
  public:
    StreamedSource(ScratchFile copy, std::unique_ptr<VolumeSource> inner)
        : DescribedSource(std::move(inner)), copy_(std::move(copy)) {}
    [[nodiscard]] VolumeDescription describe() const override {
        VolumeDescription result = inner_source().describe();
        result.name = kName;
        return result;
    }
    /// The next run would find nothing there.
    [[nodiscard]] std::string identity() const override { return ""; }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override { return {}; }

  private:
    ScratchFile copy_;
};

void copy_all(int descriptor, ScratchFile& copy) {
    std::vector<std::byte> buffer(std::size_t{1} << 20U);
    std::uint64_t at = 0;
    while (true) {
        const ssize_t n = ::read(descriptor, buffer.data(), buffer.size());
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n < 0) {
            throw Error(ErrorKind::io, {kName},
                        fmt::format("cannot read: {}", std::strerror(errno)));
        }
        if (n == 0) {
            break;
        }
        copy.write_at(at, {buffer.data(), static_cast<std::size_t>(n)});
        at += static_cast<std::uint64_t>(n);
    }
    if (at == 0) {
        throw Error(ErrorKind::invalid_argument, {kName}, "there is nothing to read");
    }
}

/// A name of the copy for as long as HDF5 opens it: it does not take /proc's.
class ShortName {
  public:
    ShortName(const ScratchFile& copy, const std::filesystem::path& folder)
        : name_(folder / fmt::format("{}{}", ScratchFile::kPrefix, ::getpid())) {
        const std::string from = fmt::format("/proc/self/fd/{}", copy.descriptor());
        if (::linkat(AT_FDCWD, from.c_str(), AT_FDCWD, name_.c_str(), AT_SYMLINK_FOLLOW) != 0) {
            throw Error(ErrorKind::unsupported, {kName},
                        fmt::format("HDF5 needs a file with a name, which its temporary copy in {} "
                                    "cannot be given ({}): name the file instead",
                                    folder.string(), std::strerror(errno)));
        }
    }
    ShortName(const ShortName&) = delete;
    ShortName& operator=(const ShortName&) = delete;
    ~ShortName() { ::unlink(name_.c_str()); }
    [[nodiscard]] const std::filesystem::path& path() const { return name_; }

  private:
    std::filesystem::path name_;
};

/// The same error about what the user named.
[[noreturn]] void rethrow_named(const Error& error, const std::string& path) {
    ErrorPlace place = error.place();
    if (place.file.starts_with(path)) {
        place.file = kName + place.file.substr(path.size());
    }
    throw Error(error.kind(), place, error.problem(), error.remedies());
}

}  // namespace

std::unique_ptr<VolumeSource> open_volume_stream(int descriptor,
                                                 const std::filesystem::path& scratch_folder,
                                                 const SourceOptions& options) {
    ScratchFile copy(scratch_folder);
    copy_all(descriptor, copy);
    std::string path = fmt::format("/proc/self/fd/{}", copy.descriptor());
    std::optional<ShortName> name;
    if (is_hdf5(std::filesystem::path(path))) {
        name.emplace(copy, scratch_folder);
        path = name->path().string();
    }
    try {
        std::unique_ptr<VolumeSource> source = open_volume(path, options);
        return std::make_unique<StreamedSource>(std::move(copy), std::move(source));
    } catch (const Error& error) {
        rethrow_named(error, path);
    }
}

}  // namespace isonest
