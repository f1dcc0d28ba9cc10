#include "preprocess/sources/zarr/zarr_files.h"

#include <fmt/format.h>

#include <system_error>

#include <isonest/error.h>

#include "preprocess/sources/bytes/file_identity.h"
#include "preprocess/sources/bytes/json_file.h"
#include "preprocess/sources/bytes/regular_file.h"

namespace isonest::detail {
namespace {

namespace fs = std::filesystem;

/// A link that leads to nothing is no chunk that was not written.
bool is_there(const fs::path& file) {
    std::error_code error;
    return fs::exists(fs::symlink_status(file, error));
}

class LocalZarrFiles : public ZarrFiles {
  public:
    explicit LocalZarrFiles(Path root) : root_(std::move(root)) {}

    [[nodiscard]] const Path& root() const override { return root_; }
    [[nodiscard]] bool is_far() const override { return false; }
    std::optional<nlohmann::json> json(const Path& file) override { return read_json(file); }
    [[nodiscard]] bool has(const Path& file) override {
        std::error_code error;
        return fs::is_regular_file(file, error);
    }
    [[nodiscard]] bool may_have_folder(const Path& folder) override {
        std::error_code error;
        return fs::is_directory(folder, error);
    }
    std::optional<std::vector<std::string>> folders_in(const Path& folder) override {
        constexpr std::size_t kMost = 10000;
        std::vector<std::string> names;
        std::error_code error;
        for (auto entry = fs::directory_iterator(folder, error);
             !error && entry != fs::directory_iterator(); entry.increment(error)) {
            std::error_code unknown;
            if (entry->is_directory(unknown)) {
                names.push_back(entry->path().filename().string());
            }
            if (names.size() > kMost) {
                break;
            }
        }
        return names;
    }
    [[nodiscard]] bool is_same(const Path& a, const Path& b) override {
        std::error_code error;
        return fs::equivalent(a, b, error);
    }
    void read_anew(const Path& /*folder*/) override {}
    void refuse() const override {}
    [[nodiscard]] std::vector<std::string> notes() const override { return {}; }

    std::optional<std::vector<std::byte>> chunk(const Path& file,
                                                const ZarrChunkPlace& place) override {
        if (!is_there(file)) {
            return std::nullopt;
        }
        const std::uint64_t size = regular_file_size(file);
        check_packed(size, place);
        return range(file, {0, size}, place);
    }
    std::optional<ZarrIndexBytes> index(const Path& file, std::uint64_t size, bool at_end,
                                        const std::string& name) override {
        if (!is_there(file)) {
            return std::nullopt;
        }
        const std::string where = file.filename().string();
        ZarrIndexBytes index;
        index.file_size = regular_file_size(file);
        if (index.file_size < size) {
            throw Error(ErrorKind::corrupt, {name, where}, "a shard shorter than its index");
        }
        index.bytes = range(file, {at_end ? index.file_size - size : 0, size}, {name, where});
        return index;
    }
    std::optional<ZarrIndexBytes> index_at_hand(const Path& /*file*/, std::uint64_t /*size*/,
                                                bool /*at_end*/) override {
        return std::nullopt;
    }
    std::vector<std::byte> range(const Path& file, const ByteRange& range,
                                 const ZarrChunkPlace& place) override {
        const std::string text =
            first_bytes(file, static_cast<std::size_t>(range.size), range.offset);
        if (text.size() != range.size || range.size == 0) {
            throw Error(ErrorKind::corrupt, {place.name, place.where}, "its file is too short");
        }
        const auto bytes = std::as_bytes(std::span(text));
        return {bytes.begin(), bytes.end()};
    }
    void want(std::span<const ZarrPart> /*parts*/) override {}

    [[nodiscard]] std::vector<Path> files(const std::vector<Path>& descriptions) const override {
        return descriptions;
    }
    [[nodiscard]] std::string identity(const std::vector<Path>& descriptions,
                                       const std::vector<Path>& chunks) const override {
        std::vector<Path> looked_at = descriptions;
        looked_at.insert(looked_at.end(), chunks.begin(), chunks.end());
        return identity_of(looked_at);
    }
    [[nodiscard]] FetchedCounts fetched() const override { return {}; }

  private:
    Path root_;
};

}  // namespace

void check_packed(std::uint64_t packed, const ZarrChunkPlace& place) {
    if (packed > most_packed(place.bytes)) {
        throw Error(ErrorKind::corrupt, {place.name, place.where},
                    fmt::format("{} bytes for a chunk of {}", packed, place.bytes));
    }
}

std::shared_ptr<ZarrFiles> local_zarr_files(std::filesystem::path root) {
    return std::make_shared<LocalZarrFiles>(std::move(root));
}

}  // namespace isonest::detail
