#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <system_error>

#include <isonest/error.h>
#include <isonest/tileset.h>

#include "query/tiles/tileset_maker.h"
#include "store/files/output_file.h"

namespace isonest {
namespace detail {
namespace {

/// Writes files into an unfinished folder. Thread-safe.
class TileFiles {
  public:
    explicit TileFiles(std::filesystem::path folder) : folder_(std::move(folder)) {}

    /// `path`: in the folder; its folders are created. Returns the number of bytes.
    std::uint64_t write(const std::string& path, const std::string& bytes) {
        const std::filesystem::path file = folder_ / path;
        std::error_code error;
        std::filesystem::create_directories(file.parent_path(), error);
        const int fd = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        bool fails = fd < 0;
        int reason = errno;
        for (std::size_t done = 0; !fails && done < bytes.size();) {
            const ::ssize_t n = ::write(fd, bytes.data() + done, bytes.size() - done);
            fails = n < 0 && errno != EINTR;
            reason = errno;
            done += n > 0 ? static_cast<std::size_t>(n) : 0;
        }
        if (fd >= 0 && ::close(fd) != 0 && !fails) {
            fails = true;
            reason = errno;
        }
        if (fails) {
            throw Error(ErrorKind::io, {file.string()},
                        fmt::format("cannot be written: {}", std::strerror(reason)));
        }
        ++files_;
        bytes_ += bytes.size();
        return bytes.size();
    }
    /// Waits until everything is on the disk.
    void sync() const {
        const int fd = ::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
        const bool fails = fd < 0 || ::syncfs(fd) != 0;
        const int reason = errno;
        if (fd >= 0) {
            ::close(fd);
        }
        if (fails) {
            throw Error(ErrorKind::io, {folder_.string()},
                        fmt::format("cannot be synced: {}", std::strerror(reason)));
        }
    }
    [[nodiscard]] std::uint64_t files() const { return files_; }
    [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

  private:
    std::filesystem::path folder_;
    std::atomic<std::uint64_t> files_ = 0;
    std::atomic<std::uint64_t> bytes_ = 0;
};

/// Throws Error{invalid_argument} unless the folder has only the files of a tileset.
void require_tileset(const std::filesystem::path& folder) {
    bool others = false;
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
        const std::filesystem::path name = entry.path().filename();
        others = others || (name != "tileset.json" && name != "tiles");
    }
    std::ifstream file(folder / "tileset.json");
    constexpr std::size_t kHead = 64;
    std::string text(kHead, ' ');
    file.read(text.data(), kHead);
    if (others || text.find(R"("generator":"isonest")") == std::string::npos) {
        throw Error(
            ErrorKind::invalid_argument, {folder.string()},
            "is a folder that holds more than a tileset made by isonest; it will not be replaced",
            {{RemedyKind::other_name}});
    }
}

}  // namespace
}  // namespace detail

struct Tileset::Parts {
    Parts(const std::filesystem::path& folder, const TilesetOptions& options)
        : output(folder, options.replace, detail::require_tileset),
          files(output.name()),
          maker(folder, options, [this](const std::string& path, const std::string& bytes) {
              files.write(path, bytes);
          }) {}

    detail::OutputFolder output;
    detail::TileFiles files;
    detail::TilesetMaker maker;
};

Tileset::Tileset(const std::filesystem::path& folder, const TilesetOptions& options) {
    detail::require_options(options);
    parts_ = std::make_unique<Parts>(folder, options);
}

Tileset::~Tileset() = default;

std::unique_ptr<MeshSink> Tileset::sink(std::size_t feature) {
    return parts_->maker.sink(feature);
}

TilesetReport Tileset::finish(const TilesetSource& source, Progress& progress) {
    Parts& p = *parts_;
    TilesetReport report;
    report.levels = p.maker.finish(source, progress);
    p.files.sync();
    progress.check();
    p.output.publish();
    report.files = p.files.files();
    report.bytes = p.files.bytes();
    report.scratch_bytes = p.maker.scratch_bytes();
    return report;
}

}  // namespace isonest
