#include "preprocess/sources/zarr/zarr_files.h"

#include <fmt/format.h>
#include <zlib.h>

#include <array>
#include <cstring>
#include <map>
#include <string_view>
#include <system_error>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/bytes/packed_block.h"
#include "preprocess/sources/bytes/stream_bytes.h"

namespace isonest::detail {

const nlohmann::json& member(const nlohmann::json& object, const char* key) {
    static const nlohmann::json null;
    const auto it = object.is_object() ? object.find(key) : object.end();
    return object.is_object() && it != object.end() ? *it : null;
}

const nlohmann::json& entries(const nlohmann::json& object, const char* key) {
    static const nlohmann::json none = nlohmann::json::array();
    const nlohmann::json& list = member(object, key);
    return list.is_array() ? list : none;
}
namespace {

namespace fs = std::filesystem;

/// A broken link does not count as a chunk that was never written.
bool is_there(const fs::path& file) {
    std::error_code error;
    return fs::exists(fs::symlink_status(file, error));
}

/// The index of `size` bytes at the end or the beginning of a shard of `file_size` bytes.
/// Throws Error{corrupt} if the shard is shorter.
ZarrIndexBytes index_of(ZarrFiles& files, const fs::path& file, std::uint64_t file_size,
                        std::uint64_t size, bool at_end, const ZarrChunkPlace& place) {
    if (file_size < size) {
        throw Error(ErrorKind::corrupt, {place.name, place.where},
                    "the shard is shorter than its index");
    }
    ZarrIndexBytes index;
    index.file_size = file_size;
    index.bytes = files.range(file, {at_end ? file_size - size : 0, size}, place);
    return index;
}

class LocalZarrFiles : public ZarrFiles {
  public:
    explicit LocalZarrFiles(Path root) : root_(std::move(root)) {}

    [[nodiscard]] const Path& root() const override { return root_; }
    [[nodiscard]] bool is_remote() const override { return false; }
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
        constexpr std::size_t kMax = 10000;
        std::vector<std::string> names;
        std::error_code error;
        for (auto entry = fs::directory_iterator(folder, error);
             !error && entry != fs::directory_iterator(); entry.increment(error)) {
            std::error_code unknown;
            if (entry->is_directory(unknown)) {
                names.push_back(entry->path().filename().string());
            }
            if (names.size() > kMax) {
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
        return index_of(*this, file, regular_file_size(file), size, at_end, {name, where});
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
            throw Error(ErrorKind::corrupt, {place.name, place.where}, "the file is too short");
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
    if (packed > max_packed(place.bytes)) {
        throw Error(ErrorKind::corrupt, {place.name, place.where},
                    fmt::format("{} compressed bytes are too many for a chunk of {} bytes", packed,
                                place.bytes));
    }
}

std::shared_ptr<ZarrFiles> local_zarr_files(std::filesystem::path root) {
    return std::make_shared<LocalZarrFiles>(std::move(root));
}

// A Zarr hierarchy in a ZIP archive whose members are stored or deflated.

namespace {

constexpr std::array<std::string_view, 3> kAtTheTop{".zarray", ".zgroup", "zarr.json"};

class ZipZarrFiles : public ZarrFiles {
  public:
    ZipZarrFiles(Path archive, const std::string& inside)
        : archive_(std::move(archive)), root_(inside.empty() ? archive_ : archive_ / inside) {
        for (ZipMember& member : read_zip_directory(archive_)) {
            std::string name = member.name;
            members_[std::move(name)] = std::move(member);  // the last one of a name counts
        }
    }

    [[nodiscard]] const Path& root() const override { return root_; }
    [[nodiscard]] bool is_remote() const override { return false; }
    std::optional<nlohmann::json> json(const Path& file) override {
        const ZipMember* const member = find(file);
        if (member == nullptr) {
            return std::nullopt;
        }
        if (member->bytes > kMaxJsonBytes) {
            throw Error(ErrorKind::unsupported, {file.string()},
                        fmt::format("the metadata have more than {} bytes, which is the limit",
                                    kMaxJsonBytes));
        }
        const std::vector<std::byte> bytes = unpacked(*member, file.string());
        return parse_json({reinterpret_cast<const char*>(bytes.data()), bytes.size()},
                          file.string());
    }
    [[nodiscard]] bool has(const Path& file) override { return find(file) != nullptr; }
    [[nodiscard]] bool may_have_folder(const Path& folder) override {
        const std::string below = name_of(folder) + "/";
        const auto it = members_.lower_bound(below);
        return it != members_.end() && it->first.starts_with(below);
    }
    std::optional<std::vector<std::string>> folders_in(const Path& folder) override {
        constexpr std::size_t kMax = 10000;
        const std::string name = name_of(folder);
        const std::string below = name.empty() ? "" : name + "/";
        std::vector<std::string> names;
        for (auto it = members_.lower_bound(below);
             it != members_.end() && it->first.starts_with(below) && names.size() <= kMax;) {
            const std::size_t end = it->first.find('/', below.size());
            if (end == std::string::npos) {
                ++it;
                continue;
            }
            names.push_back(it->first.substr(below.size(), end - below.size()));
            // Skips all names that begin with this folder and a slash.
            it = members_.lower_bound(it->first.substr(0, end) + static_cast<char>('/' + 1));
        }
        return names;
    }
    [[nodiscard]] bool is_same(const Path& a, const Path& b) override {
        return name_of(a) == name_of(b);
    }
    void read_anew(const Path& /*folder*/) override {}
    void refuse() const override {}
    [[nodiscard]] std::vector<std::string> notes() const override { return {}; }

    std::optional<std::vector<std::byte>> chunk(const Path& file,
                                                const ZarrChunkPlace& place) override {
        const ZipMember* const member = find(file);
        if (member == nullptr) {
            return std::nullopt;
        }
        check_packed(member->bytes, place);
        return unpacked(*member, place.name + ": " + place.where);
    }
    std::optional<ZarrIndexBytes> index(const Path& file, std::uint64_t size, bool at_end,
                                        const std::string& name) override {
        const ZipMember* const member = find(file);
        if (member == nullptr) {
            return std::nullopt;
        }
        const std::string where = file.filename().string();
        if (member->deflated) {
            throw Error(ErrorKind::unsupported, {name, where},
                        "the shard is compressed in the archive; unpack the archive, or store it "
                        "without compression (zip -0)");
        }
        return index_of(*this, file, member->bytes, size, at_end, {name, where});
    }
    std::optional<ZarrIndexBytes> index_at_hand(const Path& /*file*/, std::uint64_t /*size*/,
                                                bool /*at_end*/) override {
        return std::nullopt;
    }
    std::vector<std::byte> range(const Path& file, const ByteRange& range,
                                 const ZarrChunkPlace& place) override {
        const ZipMember* const member = find(file);
        const std::string where = place.name + ": " + place.where;
        if (member == nullptr || member->deflated || range.size == 0 ||
            !lies_within(range.offset, range.size, member->bytes)) {
            throw Error(ErrorKind::corrupt, {where}, "the shard is too short");
        }
        require_readable(*member, where);
        return stored(member->start + range.offset, range.size, where);
    }
    void want(std::span<const ZarrPart> /*parts*/) override {}

    [[nodiscard]] std::vector<Path> files(
        const std::vector<Path>& /*descriptions*/) const override {
        return {archive_};
    }
    [[nodiscard]] std::string identity(const std::vector<Path>& /*descriptions*/,
                                       const std::vector<Path>& /*chunks*/) const override {
        return identity_of({archive_});
    }
    [[nodiscard]] FetchedCounts fetched() const override { return {}; }

  private:
    /// The name in the archive, without leading and trailing slashes.
    [[nodiscard]] std::string name_of(const Path& path) const {
        std::string name = path.lexically_normal().native();
        const std::string archive = archive_.lexically_normal().native();
        name.erase(0, std::min(name.size(), archive.size()));
        const std::size_t begin = name.find_first_not_of('/');
        const std::size_t end = name.find_last_not_of('/');
        return begin == std::string::npos ? "" : name.substr(begin, end - begin + 1);
    }
    [[nodiscard]] const ZipMember* find(const Path& file) const {
        const auto it = members_.find(name_of(file));
        return it == members_.end() ? nullptr : &it->second;
    }
    static void require_readable(const ZipMember& member, const std::string& where) {
        if (!member.readable) {
            throw Error(
                ErrorKind::unsupported, {where},
                "it is encrypted in the archive, or compressed by a method other than deflate");
        }
        if (!member.deflated && member.packed != member.bytes) {
            throw Error(ErrorKind::corrupt, {where},
                        fmt::format("{} uncompressed bytes are stored as {} bytes", member.bytes,
                                    member.packed));
        }
    }
    [[nodiscard]] std::vector<std::byte> stored(std::uint64_t at, std::uint64_t size,
                                                const std::string& where) const {
        const std::string text = first_bytes(archive_, static_cast<std::size_t>(size), at);
        if (text.size() != size) {
            throw Error(ErrorKind::corrupt, {where}, "the archive is too short");
        }
        const auto bytes = std::as_bytes(std::span(text));
        return {bytes.begin(), bytes.end()};
    }
    /// REQUIRES: the member's size was checked.
    [[nodiscard]] std::vector<std::byte> unpacked(const ZipMember& member,
                                                  const std::string& where) const {
        require_readable(member, where);
        std::vector<std::byte> bytes;
        if (member.deflated) {
            bytes.resize(static_cast<std::size_t>(member.bytes));
            GzipStream stream(archive_, where, member.start, DeflateWrapper::none);
            if (stream.read(bytes.data(), bytes.size()) != bytes.size()) {
                throw Error(ErrorKind::corrupt, {where},
                            fmt::format("the data do not decompress to {} bytes", member.bytes));
            }
        } else {
            bytes = stored(member.start, member.bytes, where);
        }
        if (::crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()) !=
            member.crc) {
            throw Error(ErrorKind::corrupt, {where}, "the checksum in the archive is wrong");
        }
        return bytes;
    }

    Path archive_;
    Path root_;
    std::map<std::string, ZipMember> members_;
};

}  // namespace

std::optional<std::string> zarr_in_zip(const std::filesystem::path& archive) {
    std::optional<std::string> inside;
    for (const ZipMember& member : read_zip_directory(archive)) {
        for (const std::string_view description : kAtTheTop) {
            if (member.name == description) {
                return "";
            }
            const std::size_t slash = member.name.find('/');
            if (slash != std::string::npos && slash > 0 &&
                std::string_view(member.name).substr(slash + 1) == description) {
                if (inside && *inside != member.name.substr(0, slash)) {
                    return std::nullopt;  // several
                }
                inside = member.name.substr(0, slash);
            }
        }
    }
    return inside;
}

std::shared_ptr<ZarrFiles> zip_zarr_files(const std::filesystem::path& archive,
                                          const std::string& inside) {
    return std::make_shared<ZipZarrFiles>(archive, inside);
}

}  // namespace isonest::detail
