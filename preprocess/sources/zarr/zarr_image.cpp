#include "preprocess/sources/zarr/zarr_image.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"

namespace isonest::detail {
namespace {

using nlohmann::json;

/// Its "label-value", if that is an integer.
std::optional<std::int64_t> label_value(const json& entry) {
    const auto it = entry.is_object() ? entry.find("label-value") : entry.end();
    if (!entry.is_object() || it == entry.end() || !it->is_number_integer()) {
        return std::nullopt;
    }
    constexpr std::uint64_t kMax = std::numeric_limits<std::int64_t>::max();
    if (it->is_number_unsigned() && it->get<std::uint64_t>() > kMax) {
        return std::nullopt;
    }
    return it->get<std::int64_t>();
}

/// Opacity, the fourth number, is dropped.
std::optional<LabelColor> color_of_rgba(const json& rgba) {
    constexpr std::int64_t kMax = 255;
    LabelColor color{};
    if (!rgba.is_array() || rgba.size() < color.size() || rgba.size() > color.size() + 1) {
        return std::nullopt;
    }
    for (std::size_t i = 0; i < color.size(); ++i) {
        const bool whole = rgba[i].is_number_integer();
        const auto part = whole ? rgba[i].get<std::int64_t>() : -1;
        if (part < 0 || part > kMax) {
            return std::nullopt;
        }
        color.at(i) = static_cast<std::uint8_t>(part);
    }
    return color;
}

}  // namespace

FoundLabels labels_of_ome(const json& image_label) {
    FoundLabels labels;
    for (const json& entry : entries(image_label, "properties")) {
        const auto id = label_value(entry);
        if (!id) {
            labels.leave_out("a property whose label-value is not a whole number");
            continue;
        }
        for (const char* const key : {"name", "class"}) {
            const auto it = entry.find(key);
            if (it != entry.end() && it->is_string()) {
                labels.add(*id, it->get<std::string>(), std::nullopt);
                break;
            }
        }
    }
    for (const json& entry : entries(image_label, "colors")) {
        const auto id = label_value(entry);
        const auto rgba = entry.is_object() ? entry.find("rgba") : entry.end();
        if (!id) {
            labels.leave_out("a colour whose label-value is not a whole number");
        } else if (rgba != entry.end()) {
            if (const auto color = color_of_rgba(*rgba)) {
                labels.add(*id, "", color);
            } else {
                labels.leave_out(
                    fmt::format("label {}: its colour is not whole numbers from 0 to 255", *id));
            }
        }
    }
    return labels;
}

namespace {

namespace fs = std::filesystem;

/// OME's list of images in a group; null if it has none.
const json& multiscales(const json& attributes) {
    const json& inside = member(member(attributes, "ome"), "multiscales");
    return inside.is_null() ? member(attributes, "multiscales") : inside;
}

/// What OME says about an array.
struct OmePlace {
    std::shared_ptr<const json> image;
    json dataset;
    std::shared_ptr<const json> labels;  ///< "image-label"; null if there is none
};

ZarrImage image_of(ZarrFiles& files, const fs::path& folder, const std::optional<OmePlace>& ome) {
    ZarrImage image;
    files.read_anew(folder);
    image.array = read_zarr_array(files, folder);
    image.files.push_back(image.array.description);
    const std::size_t count = image.array.shape.size();
    image.map = AxisMap(count);
    OmeCoordinates coordinates;
    if (ome) {
        coordinates = ome_coordinates(*ome->image, ome->dataset, count, folder.string());
        image.labels = labels_of_ome(*ome->labels);
        image.map = coordinates.map;
        image.says_scale = coordinates.says_scale;
        image.notes = coordinates.notes;
    }
    image.ome = ome.has_value();
    for (std::size_t i = 0; i < count; ++i) {
        ArrayAxis axis;
        axis.length = static_cast<std::int64_t>(image.array.shape[i]);
        if (!image.array.names.empty()) {
            axis.name = image.array.names[i];
        }
        if (!coordinates.array.empty()) {
            const OmeAxis& said = coordinates.array[i];
            axis.name = said.name;
            axis.of_volume = said.type.empty()
                                 ? axis.name == "x" || axis.name == "y" || axis.name == "z"
                                 : said.type == "space";
        }
        image.axes.push_back(axis);
    }
    image.units.assign(count, "");
    const std::vector<OmeAxis>& world =
        coordinates.world.empty() ? coordinates.array : coordinates.world;
    for (std::size_t i = 0; i < world.size(); ++i) {
        image.units[i] = world[i].unit;
    }
    for (const OmeAxis& axis : coordinates.world) {
        image.world.push_back(axis.name);
    }
    return image;
}

/// Requires a path within the folder.
std::string inner_path(const json& path, const fs::path& folder) {
    const std::string text = path.is_string() ? path.get<std::string>() : "";
    const fs::path p(text);
    if (text.empty() || p.is_absolute() ||
        std::any_of(p.begin(), p.end(), [](const fs::path& part) { return part == ".."; })) {
        throw Error(ErrorKind::corrupt, {folder.string(), "multiscales"},
                    fmt::format("a level has the invalid path {:.80}", path.dump()));
    }
    return text;
}

/// OME's levels in a group, with their descriptions.
std::vector<std::pair<std::string, OmePlace>> levels_of(ZarrFiles& files, const fs::path& folder) {
    std::vector<std::pair<std::string, OmePlace>> levels;
    const json attributes = zarr_group_attributes(files, folder);
    const json& inside = member(member(attributes, "ome"), "image-label");
    const auto labels =
        std::make_shared<const json>(inside.is_null() ? member(attributes, "image-label") : inside);
    for (const json& image : multiscales(attributes)) {
        // One copy, shared by all its levels.
        const auto shared = std::make_shared<const json>(image);
        for (const json& dataset : member(image, "datasets")) {
            levels.emplace_back(inner_path(member(dataset, "path"), folder),
                                OmePlace{shared, dataset, labels});
        }
    }
    return levels;
}

fs::path attributes_file(ZarrFiles& files, const fs::path& folder) {
    const fs::path v3 = folder / "zarr.json";
    return files.has(v3) ? v3 : folder / ".zattrs";
}

/// A list of texts, each the name of a folder below.
std::vector<std::string> names_in(const json& list, const fs::path& folder) {
    std::vector<std::string> names;
    for (const json& name : list.is_array() ? list : json::array()) {
        if (name.is_string()) {
            names.push_back(inner_path(name, folder));
        }
    }
    return names;
}

/// The members of a group according to its OME metadata: the labels of an image, the images of a
/// well, or those that bioformats2raw numbers. None if there is no such information.
std::optional<std::vector<std::string>> members_by_ome(ZarrFiles& files, const fs::path& folder) {
    constexpr int kMaxImages = 1000;
    const json attributes = zarr_group_attributes(files, folder);
    const json& ome = member(attributes, "ome");
    for (const json* const said : {&ome, &attributes}) {
        if (member(*said, "labels").is_array()) {
            return names_in(member(*said, "labels"), folder);
        }
        if (const json& images = member(member(*said, "well"), "images"); images.is_array()) {
            json paths = json::array();
            for (const json& image : images) {
                paths.push_back(member(image, "path"));
            }
            return names_in(paths, folder);
        }
        if (member(*said, "bioformats2raw.layout").is_null()) {
            continue;
        }
        const json of_series = zarr_group_attributes(files, folder / "OME");
        for (const json* const inside : {&member(of_series, "ome"), &of_series}) {
            if (member(*inside, "series").is_array()) {
                return names_in(member(*inside, "series"), folder);
            }
        }
        std::vector<std::string> names;
        for (int i = 0; i < kMaxImages && is_zarr_group(files, folder / std::to_string(i)); ++i) {
            names.push_back(std::to_string(i));
        }
        return names;
    }
    return std::nullopt;
}

std::vector<std::string> members_of(ZarrFiles& files, const fs::path& folder) {
    if (auto listed = files.folders_in(folder)) {
        return *std::move(listed);
    }
    if (auto said = members_by_ome(files, folder)) {
        return *std::move(said);
    }
    if (!is_zarr_group(files, folder)) {
        files.refuse();
        throw Error(ErrorKind::not_found, {folder.string()},
                    "there is no Zarr array or group at this URL (zarr.json, .zarray, .zgroup, "
                    ".zmetadata)",
                    {{RemedyKind::check_url}});
    }
    throw Error(ErrorKind::invalid_argument, {folder.string()},
                "the members of this group cannot be listed at a URL, because it has no "
                "consolidated metadata",
                {{RemedyKind::choose_dataset}});
}

struct Candidate {
    fs::path folder;  ///< relative to the root
    bool ome;
};

/// Finds arrays and OME images in a group, to a depth of 4.
void search(ZarrFiles& files, const fs::path& root, const fs::path& inside, int depth,
            std::vector<Candidate>& found) {
    constexpr int kDeepest = 4;
    constexpr std::size_t kMax = 10000;
    std::vector<std::string> folders = members_of(files, root / inside);
    std::sort(folders.begin(), folders.end(), naturally_less);
    for (const std::string& name : folders) {
        const fs::path path = inside / name;
        if (found.size() >= kMax) {
            return;
        }
        if (is_zarr_array(files, root / path)) {
            found.push_back({path, false});
        } else if (is_zarr_group(files, root / path)) {
            if (!levels_of(files, root / path).empty()) {
                found.push_back({path, true});
            } else if (depth < kDeepest) {
                search(files, root, path, depth + 1, found);
            }
        }
    }
}

/// Whether reading may succeed another time. A refused request may also mean that the object does
/// not exist.
bool could_not_be_fetched(const Error& error) {
    const bool is_refused =
        std::any_of(error.remedies().begin(), error.remedies().end(),
                    [](const Remedy& r) { return r.kind == RemedyKind::give_credentials; });
    return error.kind() == ErrorKind::cancelled || error.kind() == ErrorKind::limit ||
           (error.kind() == ErrorKind::io && !is_refused);
}

/// The number of axes longer than 1; none if it cannot be read.
std::size_t long_axes(ZarrFiles& files, const fs::path& root, const Candidate& candidate) {
    try {
        fs::path folder = root / candidate.folder;
        if (candidate.ome) {
            folder /= levels_of(files, folder).front().first;
        }
        const Lengths shape = read_zarr_array(files, folder).shape;
        return static_cast<std::size_t>(
            std::count_if(shape.begin(), shape.end(), [](std::uint64_t n) { return n > 1; }));
    } catch (const Error& error) {
        if (files.is_remote() && could_not_be_fetched(error)) {
            throw;
        }
        return 0;
    }
}

/// Null if several have the same number. Coordinates, which have one axis, are stored beside a
/// volume.
const Candidate* only_with_most_axes(ZarrFiles& files, const fs::path& root,
                                     const std::vector<Candidate>& found) {
    if (found.size() == 1) {
        return &found.front();
    }
    const Candidate* best = nullptr;
    std::size_t most = 0;
    for (const Candidate& candidate : found) {
        const std::size_t axes = long_axes(files, root, candidate);
        if (axes > most) {
            best = &candidate;
            most = axes;
        } else if (axes == most) {
            best = nullptr;
        }
    }
    return best;
}

std::string list_of(const std::vector<std::string>& names) {
    constexpr std::size_t kMaxListed = 40;
    std::string list;
    for (std::size_t i = 0; i < std::min(names.size(), kMaxListed); ++i) {
        list += "\n  " + names[i];
    }
    return names.size() > kMaxListed
               ? fmt::format("{}\n  and {} more", list, names.size() - kMaxListed)
           : list.empty() ? " none"
                          : list;
}

std::vector<std::string> all_names(ZarrFiles& files, const fs::path& root) {
    std::vector<std::string> names;
    for (const auto& [level, place] : levels_of(files, root)) {
        names.push_back(level);
    }
    if (names.empty()) {
        std::vector<Candidate> found;
        search(files, root, {}, 0, found);
        for (const Candidate& c : found) {
            names.push_back(c.folder.string());
        }
    }
    return names;
}

[[noreturn]] void refuse_dataset(ZarrFiles& files, const fs::path& root,
                                 const std::string& dataset) {
    files.refuse();
    std::string there;
    try {
        there = "; the folder has:" + list_of(all_names(files, root));
    } catch (const Error& error) {
        if (!files.is_remote() || error.kind() != ErrorKind::invalid_argument) {
            throw;
        }
        // Arrays cannot be listed.
    }
    throw Error(ErrorKind::not_found, {root.string()},
                fmt::format("there is no array {}{}", dataset, there));
}

/// The array at a path below the root, with OME's description if its parent is an OME image.
ZarrImage named_image(ZarrFiles& files, const fs::path& root, const std::string& dataset) {
    std::string inner = dataset;
    while (inner.starts_with('/')) {
        inner.erase(0, 1);
    }
    while (inner.ends_with('/')) {
        inner.pop_back();
    }
    const fs::path path = root / inner_path(json(inner), root);
    if (!is_zarr_array(files, path)) {
        if (files.is_remote() && !is_zarr_group(files, path)) {
            refuse_dataset(files, root, dataset);
        }
        return find_zarr_image(files, path, "");
    }
    // It may be a level of any group above it.
    for (fs::path group = path.parent_path(); group.string().size() >= root.string().size();
         group = group.parent_path()) {
        for (const auto& [level, place] : levels_of(files, group)) {
            if (files.is_same(group / level, path)) {
                ZarrImage image = image_of(files, path, place);
                image.files.push_back(attributes_file(files, group));
                return image;
            }
        }
        if (group == group.parent_path()) {
            break;
        }
    }
    return image_of(files, path, std::nullopt);
}

}  // namespace

ZarrImage find_zarr_image(ZarrFiles& files, const fs::path& root, const std::string& dataset) {
    if (!dataset.empty()) {
        const fs::path inside(dataset);
        const bool leaves = std::find(inside.begin(), inside.end(), "..") != inside.end();
        if (leaves || !files.may_have_folder(root.string() + "/" + dataset)) {
            refuse_dataset(files, root, dataset);
        }
        return named_image(files, root, dataset);
    }
    if (is_zarr_array(files, root)) {
        return image_of(files, root, std::nullopt);
    }
    if (const auto levels = levels_of(files, root); !levels.empty()) {
        if (multiscales(zarr_group_attributes(files, root)).size() > 1) {
            throw Error(
                ErrorKind::invalid_argument, {root.string()},
                "there are several images, with these levels:" + list_of(all_names(files, root)),
                {{RemedyKind::choose_dataset}});
        }
        ZarrImage image = image_of(files, root / levels.front().first, levels.front().second);
        image.files.push_back(attributes_file(files, root));
        return image;
    }
    std::vector<Candidate> found;
    search(files, root, {}, 0, found);
    if (const Candidate* const only = only_with_most_axes(files, root, found)) {
        return find_zarr_image(files, root / only->folder, "");
    }
    if (found.empty()) {
        throw Error(ErrorKind::not_found, {root.string()}, "there is no array in this Zarr group");
    }
    throw Error(ErrorKind::invalid_argument, {root.string()},
                "the group has several arrays:" + list_of(all_names(files, root)),
                {{RemedyKind::choose_dataset}});
}

}  // namespace isonest::detail
