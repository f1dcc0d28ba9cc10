// Sources: https://zarr-specs.readthedocs.io (versions 2 and 3); consolidated metadata as written
// by zarr-python: ".zmetadata" in version 2, "consolidated_metadata" of a group in version 3.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <string_view>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/zarr/zarr_files.h"
#include "store/base/checksum.h"
#include "store/bytes/store_bytes.h"
#include "store/remote/open_location.h"

namespace isonest::detail {
namespace {

constexpr std::array<const char*, 4> kDescriptions{"zarr.json", ".zarray", ".zattrs", ".zgroup"};

class RemoteZarrFiles : public ZarrFiles {
  public:
    explicit RemoteZarrFiles(std::shared_ptr<ObjectFolder> objects)
        : objects_(std::move(objects)), root_(objects_->name()) {
        std::vector<ObjectPart> parts;
        for (const char* const name : kDescriptions) {
            parts.push_back(description(name));
        }
        parts.push_back(description(kConsolidated));
        objects_->want(parts);
        for (const ObjectPart& part : parts) {
            read(part.path);
        }
        is_v3_ = is_there("zarr.json");
        is_v2_ = is_there(".zarray") || is_there(".zgroup") || is_there(kConsolidated);
        take_consolidated();
        for (const char* const name : kDescriptions) {
            Found& found = found_.at(name);
            const auto said = consolidated_.find(name);
            if (!found.json && said != consolidated_.end()) {
                found.json = said->second;
            }
        }
    }

    [[nodiscard]] const Path& root() const override { return root_; }
    [[nodiscard]] bool is_remote() const override { return true; }

    std::optional<nlohmann::json> json(const Path& file) override {
        if (!is_below_root(file)) {
            return std::nullopt;
        }
        const std::string path = inner(file);
        const auto known = found_.find(path);
        if (known != found_.end()) {
            return known->second.json;
        }
        if (has_consolidated_) {
            const auto at = consolidated_.find(path);
            return at == consolidated_.end() ? std::nullopt : std::optional(at->second);
        }
        // The root determines the version of everything below.
        if (is_v2_ != is_v3_ && (file.filename() == "zarr.json") != is_v3_) {
            return std::nullopt;
        }
        read(path);
        return found_.at(path).json;
    }
    [[nodiscard]] bool has(const Path& file) override { return json(file).has_value(); }
    [[nodiscard]] bool may_have_folder(const Path& /*folder*/) override { return true; }

    std::optional<std::vector<std::string>> folders_in(const Path& folder) override {
        if (!has_consolidated_) {
            return std::nullopt;
        }
        const std::string path = inner(folder);
        const std::string start = path.empty() ? path : path + '/';
        std::vector<std::string> names;
        for (auto at = consolidated_.lower_bound(start);
             at != consolidated_.end() && at->first.starts_with(start); ++at) {
            const std::string rest = at->first.substr(start.size());
            const std::size_t slash = rest.find('/');
            if (slash != std::string::npos &&
                std::find(names.begin(), names.end(), rest.substr(0, slash)) == names.end()) {
                names.push_back(rest.substr(0, slash));
            }
        }
        return names;
    }
    [[nodiscard]] bool is_same(const Path& a, const Path& b) override {
        return Path(inner(a)).lexically_normal() == Path(inner(b)).lexically_normal();
    }
    /// A consolidated description stays if its own file is missing or refused.
    void read_anew(const Path& folder) override {
        std::vector<ObjectPart> parts;
        for (const char* const name : kDescriptions) {
            const std::string path = inner(folder / name);
            if (!found_.contains(path) && consolidated_.contains(path)) {
                parts.push_back(description(path));
            }
        }
        objects_->want(parts);
        for (const ObjectPart& part : parts) {
            read(part.path);
            Found& found = found_.at(part.path);
            if (!found.json) {
                found.json = consolidated_.at(part.path);
            }
        }
    }
    void refuse() const override {
        if (refusal_ != nullptr) {
            throw Error(refusal_->kind(), refusal_->place(), refusal_->problem(),
                        refusal_->remedies());
        }
    }
    [[nodiscard]] std::vector<std::string> notes() const override {
        std::vector<std::string> notes;
        if (refusal_ != nullptr) {
            notes.push_back(
                fmt::format("{}{}: {}; it is taken as missing, because some servers answer like "
                            "this for objects that do not exist",
                            refusal_->place().file,
                            refusals_ > 1 ? fmt::format(" and {} more", refusals_ - 1) : "",
                            refusal_->problem()));
        }
        return notes;
    }

    std::optional<std::vector<std::byte>> chunk(const Path& file,
                                                const ZarrChunkPlace& place) override {
        const FetchedPart got =
            objects_->read({inner(file), ObjectPart::Kind::whole, max_packed(place.bytes)});
        return packed(got);
    }
    std::optional<ZarrIndexBytes> index(const Path& file, std::uint64_t size, bool at_end,
                                        const std::string& /*name*/) override {
        return index_of(objects_->read(index_part(file, size, at_end)));
    }
    std::optional<ZarrIndexBytes> index_at_hand(const Path& file, std::uint64_t size,
                                                bool at_end) override {
        const std::optional<FetchedPart> got = objects_->look_at(index_part(file, size, at_end));
        return got && got->refusal == nullptr ? index_of(*got) : std::nullopt;
    }
    std::vector<std::byte> range(const Path& file, const ByteRange& range,
                                 const ZarrChunkPlace& place) override {
        if (range.size == 0) {
            // Such a range cannot be requested.
            throw Error(ErrorKind::corrupt, {place.name, place.where}, "the file is too short");
        }
        const FetchedPart got =
            objects_->read({inner(file), ObjectPart::Kind::range, range.size, range.offset});
        const std::span<const std::byte> bytes = got.bytes.bytes();
        if (bytes.size() != range.size) {
            throw Error(ErrorKind::corrupt, {place.name, place.where}, "the file is too short");
        }
        return {bytes.begin(), bytes.end()};
    }
    void want(std::span<const ZarrPart> parts) override {
        std::vector<ObjectPart> wanted;
        wanted.reserve(parts.size());
        for (const ZarrPart& part : parts) {
            switch (part.kind) {
                case ZarrPart::Kind::chunk:
                    wanted.push_back(
                        {inner(part.file), ObjectPart::Kind::whole, max_packed(part.range.size)});
                    break;
                case ZarrPart::Kind::index_at_start:
                case ZarrPart::Kind::index_at_end:
                    wanted.push_back(index_part(part.file, part.range.size,
                                                part.kind == ZarrPart::Kind::index_at_end));
                    break;
                case ZarrPart::Kind::range:
                    wanted.push_back({inner(part.file), ObjectPart::Kind::range, part.range.size,
                                      part.range.offset});
            }
        }
        objects_->want(wanted);
    }

    [[nodiscard]] std::vector<Path> files(
        const std::vector<Path>& /*descriptions*/) const override {
        return {};
    }
    /// Chunks are not included: each would need a request.
    [[nodiscard]] std::string identity(const std::vector<Path>& descriptions,
                                       const std::vector<Path>& /*chunks*/) const override {
        // The location is included because volumes with equal descriptions can have equal ETags, if
        // these are computed from the bytes.
        std::string text = fmt::format("elsewhere {:016x}\n",
                                       checksum_of(std::as_bytes(std::span(root_.native()))));
        for (const Path& file : descriptions) {
            const std::string path = inner(file);
            const auto found = found_.find(path);
            const auto said = consolidated_.find(path);
            const std::string json = found != found_.end() && found->second.json
                                         ? found->second.json->dump()
                                     : said != consolidated_.end() ? said->second.dump()
                                                                   : std::string();
            text += fmt::format("elsewhere {} {:016x} version {:.200}\n", path,
                                checksum_of(std::as_bytes(std::span(json))),
                                found != found_.end() ? found->second.version : "");
        }
        return text;
    }
    [[nodiscard]] FetchedCounts fetched() const override { return objects_->fetched(); }

  private:
    static constexpr const char* kConsolidated = ".zmetadata";

    struct Found {
        std::optional<nlohmann::json> json;
        std::string version;
    };

    static ObjectPart description(const std::string& path) {
        return {path, ObjectPart::Kind::whole, kMaxJsonBytes};
    }
    [[nodiscard]] ObjectPart index_part(const Path& file, std::uint64_t size, bool at_end) const {
        return {inner(file), at_end ? ObjectPart::Kind::last : ObjectPart::Kind::first, size};
    }

    [[nodiscard]] bool is_below_root(const Path& file) const {
        const std::string& text = file.native();
        const std::size_t size = root_.native().size();
        return text.starts_with(root_.native()) && (text.size() == size || text[size] == '/');
    }
    /// REQUIRES: the file is below the root.
    [[nodiscard]] std::string inner(const Path& file) const {
        std::string_view text = file.native();
        text.remove_prefix(root_.native().size());
        while (text.starts_with('/')) {
            text.remove_prefix(1);
        }
        while (text.ends_with('/')) {
            text.remove_suffix(1);
        }
        return std::string(text);
    }
    [[nodiscard]] bool is_there(const char* path) const { return found_.at(path).json.has_value(); }

    void read(const std::string& path) {
        const FetchedPart got = objects_->read(description(path));
        Found found;
        if (got.refusal != nullptr) {
            ++refusals_;
            if (refusal_ == nullptr) {
                refusal_ = got.refusal;
            }
        } else if (got.is_there) {
            const std::span<const std::byte> bytes = got.bytes.bytes();
            found.json = parse_json({reinterpret_cast<const char*>(bytes.data()), bytes.size()},
                                    fmt::format("{}/{}", root_.native(), path));
            found.version = got.version;
        }
        found_[path] = std::move(found);
    }

    void consolidate(const Path& path, const nlohmann::json& described) {
        if (std::none_of(path.begin(), path.end(), [](const Path& part) { return part == ".."; })) {
            consolidated_[path.native()] = described;
        }
    }
    /// Consolidated metadata describe everything below the root.
    void take_consolidated() {
        const auto members = [](nlohmann::json& object, const char* key) {
            const auto at = object.is_object() ? object.find(key) : object.end();
            nlohmann::json list = object.is_object() && at != object.end() && at->is_object()
                                      ? at->value("metadata", nlohmann::json())
                                      : nlohmann::json();
            return list;
        };
        if (is_v3_) {
            nlohmann::json& root = *found_.at("zarr.json").json;
            const nlohmann::json list = members(root, "consolidated_metadata");
            for (const auto& [path, described] : list.items()) {
                consolidate(path + "/zarr.json", described);
            }
            has_consolidated_ = list.is_object();
            if (root.is_object()) {
                root.erase("consolidated_metadata");
            }
        }
        std::optional<nlohmann::json>& v2 = found_.at(kConsolidated).json;
        if (!is_v3_ && v2 && v2->is_object()) {
            const nlohmann::json list = v2->value("metadata", nlohmann::json());
            for (const auto& [path, described] : list.items()) {
                consolidate(path, described);
            }
            has_consolidated_ = list.is_object();
        }
        v2.reset();
    }

    static std::optional<std::vector<std::byte>> packed(const FetchedPart& got) {
        if (got.refusal != nullptr) {
            throw Error(got.refusal->kind(), got.refusal->place(),
                        got.refusal->problem() +
                            "; a server may answer like this for a missing chunk, too, if listing "
                            "is not permitted",
                        got.refusal->remedies());
        }
        if (!got.is_there) {
            return std::nullopt;
        }
        const std::span<const std::byte> bytes = got.bytes.bytes();
        return std::vector<std::byte>(bytes.begin(), bytes.end());
    }
    static std::optional<ZarrIndexBytes> index_of(const FetchedPart& got) {
        std::optional<std::vector<std::byte>> bytes = packed(got);
        if (!bytes) {
            return std::nullopt;
        }
        return ZarrIndexBytes{std::move(*bytes), got.object_size,
                              std::make_shared<HeldBytes>(got.bytes)};
    }

    std::shared_ptr<ObjectFolder> objects_;
    Path root_;
    std::map<std::string, Found> found_;
    std::map<std::string, nlohmann::json> consolidated_;
    bool has_consolidated_ = false;
    bool is_v2_ = false;
    bool is_v3_ = false;
    std::shared_ptr<const Error> refusal_;
    int refusals_ = 0;
};

}  // namespace

std::shared_ptr<ZarrFiles> remote_zarr_files(const std::filesystem::path& url,
                                             const RemoteAccess& remote) {
    return remote_zarr_files(open_folder_location(url, remote));
}
std::shared_ptr<ZarrFiles> remote_zarr_files(std::shared_ptr<ObjectFolder> objects) {
    return std::make_shared<RemoteZarrFiles>(std::move(objects));
}

}  // namespace isonest::detail
