#include "tools/cli/options/label_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <iterator>
#include <memory>
#include <span>
#include <utility>

#include <isonest/error.h>
#include <isonest/labels.h>
#include <isonest/mesh_file.h>
#include <isonest/mesher_file.h>
#include <isonest/neuroglancer_meshes.h>

#include "query/extract/labels/extract_labels.h"
#include "query/neuroglancer/label_files.h"
#include "query/neuroglancer/shards.h"
#include "store/files/output_file.h"
#include "tools/cli/options/label_names.h"
#include "tools/cli/options/surface_options.h"
#include "tools/cli/options/tile_output.h"
#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMaxLabel = (std::int64_t{1} << 62U) - 1;
constexpr const char* kNeuroglancer = "neuroglancer";
constexpr const char* kDetails = "neuroglancer-multilod";
constexpr const char* kShards = "neuroglancer-sharded";
constexpr std::array kFormats{"ply", "stl",         "obj",    "vtp",   "vtkhdf", "glb",
                              "3mf", kNeuroglancer, kDetails, kShards, kTiles};

/// Parses "all", "3,7,12-20" or "liver,spleen". Items that are not numbers are appended to `names`.
std::vector<std::pair<std::int64_t, std::int64_t>> parse_labels(const std::string& text,
                                                                std::vector<std::string>& names) {
    std::vector<std::pair<std::int64_t, std::int64_t>> ranges;
    if (text == "all") {
        return ranges;
    }
    for (std::size_t at = 0; at <= text.size();) {
        const std::size_t end = std::min(text.find(',', at), text.size());
        const std::string item = text.substr(at, end - at);
        if (!is_label_range(item)) {
            names.push_back(item);
            at = end + 1;
            continue;
        }
        // A leading dash is a sign.
        const std::size_t dash = item.find('-', 1);
        const std::int64_t first =
            parse_integer("--labels", item.substr(0, dash), -kMaxLabel, kMaxLabel);
        const std::int64_t last =
            dash == std::string::npos
                ? first
                : parse_integer("--labels", item.substr(dash + 1), -kMaxLabel, kMaxLabel);
        if (last < first) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--labels '{}': the smaller number comes first", item));
        }
        ranges.emplace_back(first, last);
        at = end + 1;
    }
    return ranges;
}

/// Parses the number of passes of --smooth; "true" stands for a flag without a value.
LabelSmoothing parse_smoothing(const std::string& text) {
    LabelSmoothing smoothing;
    if (text != "true") {
        smoothing.passes =
            static_cast<int>(parse_integer("--smooth", text, 0, LabelSmoothing::kMaxPasses));
    }
    return smoothing;
}

/// "; the nearest ones are 3 and 7". `place`: the index at which the missing label would be
/// inserted.
std::string nearest_text(const std::vector<Label>& all, std::ptrdiff_t place) {
    const auto at = static_cast<std::size_t>(place);
    if (all.empty()) {
        return "; the store has no labels";
    }
    return at == 0 ? fmt::format("; the smallest is {}", all.front().id)
           : at == all.size()
               ? fmt::format("; the largest is {}", all.back().id)
               : fmt::format("; the nearest ones are {} and {}", all[at - 1].id, all[at].id);
}

/// The requested labels. Throws Error{not_found} if a label that is named individually does not
/// exist.
std::vector<Label> chosen_of(const std::vector<Label>& all,
                             const std::vector<std::pair<std::int64_t, std::int64_t>>& ranges,
                             const std::string& store) {
    std::vector<Label> chosen;
    const auto from = [&](std::int64_t id) {
        return std::lower_bound(all.begin(), all.end(), id,
                                [](const Label& label, std::int64_t i) { return label.id < i; });
    };
    for (const auto& [first, last] : ranges) {
        const auto begin = from(first);
        const auto end = last == kMaxLabel ? all.end() : from(last + 1);
        if (begin == end) {
            throw Error(
                ErrorKind::not_found, {store},
                (first == last ? fmt::format("there is no label {}", first)
                               : fmt::format("there are no labels from {} to {}", first, last)) +
                    nearest_text(all, begin - all.begin()));
        }
        chosen.insert(chosen.end(), begin, end);
    }
    if (ranges.empty()) {
        std::copy_if(all.begin(), all.end(), std::back_inserter(chosen),
                     [](const Label& label) { return label.id != 0; });
    }
    std::sort(chosen.begin(), chosen.end(),
              [](const Label& a, const Label& b) { return a.id < b.id; });
    chosen.erase(std::unique(chosen.begin(), chosen.end(),
                             [](const Label& a, const Label& b) { return a.id == b.id; }),
                 chosen.end());
    return chosen;
}

void write_text(const fs::path& path, const std::string& text) {
    OutputFile file(path, true);
    file.write_at(0, std::as_bytes(std::span(text)));
    file.publish_as_named();
}

/// File name of the mesh of a label.
std::string mesh_name(std::int64_t id, const std::string& format) {
    return format == kDetails || format == kShards
               ? fmt::format("{}", id)
               : fmt::format("{}.{}", id, format == kNeuroglancer ? "ngmesh" : format);
}

/// Writes one manifest per label, which names the file of its mesh, and the names of the labels.
void write_neuroglancer(const fs::path& folder, const Store& store,
                        const std::vector<Label>& labels) {
    Json info = {{"@type", "neuroglancer_legacy_mesh"}};
    for (const Label& label : labels) {
        write_text(folder / fmt::format("{}:0", label.id),
                   Json{{"fragments", {mesh_name(label.id, kNeuroglancer)}}}.dump() + "\n");
    }
    const std::vector<LabelName> names = names_of(store, labels);
    if (!names.empty()) {
        write_segment_properties(folder, names);
        info["segment_properties"] = "segment_properties";
    }
    write_segment_colors(folder, known_of(store, labels));
    write_text(folder / "info", info.dump() + "\n");
}

/// The sum of both.
ComponentReport added(const ComponentReport& a, const ComponentReport& b) {
    return {a.components + b.components, a.dropped + b.dropped,
            a.dropped_triangles + b.dropped_triangles,
            std::max(a.largest_dropped, b.largest_dropped)};
}

Json json_of(const std::vector<DetailLevel>& levels) {
    Json json = Json::array();
    for (const DetailLevel& level : levels) {
        json.push_back({{"distance_bound", level.bound},
                        {"triangles", level.triangles},
                        {"fragments", level.fragments},
                        {"bytes", level.bytes}});
    }
    return json;
}

Json json_of(const Store& store, const Label& label, const ExtractReport& r,
             const std::string& mesh) {
    Json json = {{"id", label.id}};
    add_label_name(store, label.id, json);
    json.update({{"nodes", label.nodes},
                 {"low", {label.low.x, label.low.y, label.low.z}},
                 {"high", {label.high.x, label.high.y, label.high.z}},
                 {"mesh", mesh},
                 {"vertices", r.vertices},
                 {"triangles", r.triangles}});
    if (r.measures) {
        json["area"] = r.measures->area;
        json["volume"] = r.measures->volume ? Json(*r.measures->volume) : Json();
    }
    if (r.distance) {
        json["distance_bound"] = r.distance->bound;
        if (r.distance->full) {
            json["full_area"] = r.distance->full->area;
            json["full_volume"] =
                r.distance->full->volume ? Json(*r.distance->full->volume) : Json();
        }
    }
    if (r.smooth) {
        add_smooth_json(*r.smooth, json);
    }
    if (r.components) {
        add_component_json(*r.components, json);
    }
    add_manifold_json(r, json);
    return json;
}

/// The sum over the meshes, with what result_of() says of one.
ExtractReport in_all_meshes(std::span<const ExtractReport> reports) {
    ExtractReport sum;
    for (const ExtractReport& r : reports) {
        sum.triangles += r.triangles;
        if (r.manifold) {
            ManifoldReport& all = sum.manifold ? *sum.manifold : sum.manifold.emplace();
            all.edges += r.manifold->edges;
            all.vertices += r.manifold->vertices;
            all.copies += r.manifold->copies;
        }
    }
    return sum;
}

}  // namespace

void add_label_options(CLI::App* c, LabelArguments& a, const std::vector<std::string>& others) {
    CLI::Option* const one = add_parsed(c, "--label", [&a](const std::string& text) {
        const bool number = is_label_range(text);
        a.one = number ? parse_integer("--label", text, -kMaxLabel, kMaxLabel) : 0;
        a.one_name = number ? std::nullopt : std::optional(text);
    });
    CLI::Option* const several = add_parsed(c, "--labels", [&a](const std::string& text) {
        a.several = parse_labels(text, a.several_names);
    });
    one->excludes(several);
    for (const std::string& other : others) {
        one->excludes(c->get_option(other));
        several->excludes(c->get_option(other));
    }
    // A value must follow "=", so that the flag never takes the name of a store.
    c->add_flag("--smooth")->each([&a](const std::string& text) {
        a.smooth = parse_smoothing(text);
    });
    c->add_flag("--keep-nodes", a.keep_nodes);
    CLI::Option* const interfaces = c->add_flag("--interfaces", a.interfaces);
    interfaces->needs(several);
    add_parsed(c, "--format", [&a](const std::string& text) {
        if (std::find(kFormats.begin(), kFormats.end(), text) == kFormats.end()) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--format '{}': give one of ply, stl, obj, vtp, vtkhdf, "
                                    "glb, 3mf, neuroglancer, neuroglancer-multilod, "
                                    "neuroglancer-sharded, 3dtiles",
                                    text));
        }
        a.format = text;
        a.has_format = true;
    })->excludes(interfaces);
    add_parsed(c, "--over",
               [&a](const std::string& text) {
                   if (text != "zarr" && text != "precomputed") {
                       throw Error(ErrorKind::invalid_argument,
                                   fmt::format("--over '{}': give zarr or precomputed", text));
                   }
                   a.over = text == "zarr" ? VoxelOrigin::middle : VoxelOrigin::corner;
               })
        ->needs(several)
        ->excludes(interfaces);
}

bool makes_detail_levels(const LabelArguments& a) {
    return a.format == kDetails || a.format == kShards;
}

void resolve_label_names(LabelArguments& a, const Store& store) {
    if (a.one_name) {
        a.one = label_named(store, *a.one_name);
        a.one_name.reset();
    }
    for (const std::string& name : a.several_names) {
        const std::int64_t id = label_named(store, name);
        a.several->emplace_back(id, id);
    }
    a.several_names.clear();
}

std::string smooth_text(const SmoothReport& r) {
    const std::string near =
        r.passes == 0 ? fmt::format("the faces of the voxels, within {:.2g}", r.bound)
                      : fmt::format(
                            "smoothed in {} passes, no point further than {:.6g} from the faces of "
                            "the voxels",
                            r.passes, r.bound);
    return near +
           (r.nodes_beyond > 0
                ? fmt::format("; all nodes further than {:.6g} from it are on the correct side",
                              r.nodes_beyond)
                : "; all nodes are on the correct side");
}

std::string sheets_text(const ExtractReport& r, const std::string& unit) {
    return r.distance
               ? fmt::format("within {:.6g}{} of {} triangles at full resolution{}; ",
                             r.distance->bound, unit, r.distance->full_triangles,
                             r.within_budget == false ? ", more triangles than asked for" : "")
               : "";
}

std::string smooth_close_text() {
    return "closed at the outer faces of the voxels at the volume's border\n";
}

void add_smooth_json(const SmoothReport& r, Json& json) {
    json["smooth_passes"] = r.passes;
    json["smooth_bound"] = r.bound;
    json["nodes_beyond"] = r.nodes_beyond;
}

namespace {

void require_place_for_over(const LabelArguments& labels) {
    if (labels.over && labels.format != kNeuroglancer && !makes_detail_levels(labels)) {
        throw Error(ErrorKind::invalid_argument,
                    "--over needs --format neuroglancer or neuroglancer-multilod");
    }
}

}  // namespace

Result extract_label_meshes(const Store& store, const LabelArguments& labels,
                            const ExtractArguments& a, const LabelQuery& query,
                            Progress& progress) {
    require_place_for_over(labels);
    const VoxelOrigin over = labels.over.value_or(VoxelOrigin::middle);
    const fs::path folder = a.mesh;
    std::error_code error;
    if (fs::exists(folder, error) && !fs::is_directory(folder, error)) {
        throw Error(ErrorKind::invalid_argument, {a.mesh},
                    "is not a folder; with --labels, give a folder for the meshes, or a name that "
                    "ends with .glb, .3mf or .vtkhdf for one file with all of them");
    }
    if (const std::string end = lower_extension(folder);
        !fs::exists(folder, error) && end.size() > 1 &&
        std::find(kFormats.begin(), kFormats.end(), end.substr(1)) != kFormats.end()) {
        throw Error(
            ErrorKind::invalid_argument, {a.mesh},
            "--labels needs a folder for the meshes, or a name that ends with .glb, .3mf or "
            ".vtkhdf for one file with all of them");
    }
    const bool is_turned = a.space != MeshSpace::automatic && a.space != MeshSpace::as_stored;
    constexpr std::array kWithFields{"ply", "vtp", "vtkhdf", "glb"};
    if (a.fields != nullptr && !makes_detail_levels(labels) && labels.format != kNeuroglancer &&
        std::find(kWithFields.begin(), kWithFields.end(), labels.format) == kWithFields.end()) {
        throw Error(ErrorKind::invalid_argument, {a.mesh},
                    fmt::format("--vertex-values: the format {} cannot store them; use --format "
                                "ply, vtp, vtkhdf or glb",
                                labels.format));
    }
    if ((makes_detail_levels(labels) || labels.format == kNeuroglancer) && a.fields != nullptr) {
        throw Error(
            ErrorKind::invalid_argument, {a.mesh},
            "--vertex-values: meshes for Neuroglancer cannot have values at their vertices");
    }
    if (makes_detail_levels(labels) && a.mesh_unit) {
        throw Error(ErrorKind::invalid_argument, {a.mesh},
                    "--mesh-unit: meshes for Neuroglancer are always in nanometres");
    }
    if (makes_detail_levels(labels) && (is_turned || a.up != UpAxis::z)) {
        throw Error(ErrorKind::invalid_argument, {a.mesh},
                    fmt::format("{}: meshes for Neuroglancer always keep the stored positions",
                                is_turned ? "--space" : "--up"));
    }
    const std::vector<Label> chosen =
        chosen_of(find_labels(store, {a.options.memory, a.options.threads}, progress),
                  *labels.several, a.store);
    fs::create_directory(folder, error);
    if (std::error_code ignored; !fs::is_directory(folder, ignored)) {
        throw Error(ErrorKind::io, {a.mesh}, "cannot create the folder: " + error.message());
    }
    ExtractOptions options = a.options;
    options.scratch = folder;
    std::vector<ExtractReport> reports(chosen.size());
    std::vector<std::vector<DetailLevel>> levels(makes_detail_levels(labels) ? chosen.size() : 0);
    LabelNeighbours neighbours(folder, chosen.size());
    const auto take = [&](std::size_t i, const ExtractReport& report) {
        reports[i] = report;
        if (reports[i].smooth) {
            neighbours.take(i, *reports[i].smooth);
        }
    };
    if (makes_detail_levels(labels)) {
        extract_neuroglancer_meshes(
            store, chosen, query, folder,
            [&](std::size_t i, const NeuroglancerReport& report) {
                take(i, report.finest);
                levels[i] = report.levels;
            },
            options, progress, over,
            labels.format == kShards ? MeshStorage::shards : MeshStorage::files);
    } else {
        extract_labels(
            store, chosen, query,
            [&](const Label& label) {
                MeshFileOptions file = label_file_options(store, label.id, a.file_options());
                file.shift = shift_of(store, over);
                return with_fields(
                    a.fields, open_mesh_file(folder / mesh_name(label.id, labels.format), file));
            },
            take, options, progress);
    }
    if (labels.format == kNeuroglancer) {
        write_neuroglancer(folder, store, chosen);
    }
    Result result;
    Json list = Json::array();
    const Sharding sharding = Sharding::of(chosen.size());
    const auto file_of = [&](std::int64_t id) {
        return labels.format == kShards
                   ? sharding.file_name(sharding.shard_of(static_cast<std::uint64_t>(id)))
                   : mesh_name(id, labels.format);
    };
    std::uint64_t triangles = 0;
    double bound = 0;
    std::optional<SmoothReport> smooth;
    std::optional<ComponentReport> components;
    std::uint64_t scratch = 0;
    for (std::size_t i = 0; i < chosen.size(); ++i) {
        list.push_back(json_of(store, chosen[i], reports[i], file_of(chosen[i].id)));
        if (!levels.empty()) {
            list.back()["levels"] = json_of(levels[i]);
        }
        triangles += reports[i].triangles;
        if (const auto& distance = reports[i].distance) {
            bound = std::max(bound, distance->bound);
        }
        if (const auto& own = reports[i].smooth) {
            scratch = std::max(scratch, reports[i].scratch_bytes);
            smooth = SmoothReport{own->passes,
                                  std::max(smooth ? smooth->bound : 0, own->bound),
                                  std::max(smooth ? smooth->nodes_beyond : 0, own->nodes_beyond),
                                  {}};
        }
        if (const auto& own = reports[i].components) {
            components = added(components.value_or(ComponentReport{}), *own);
        }
    }
    result.json = {{"folder", a.mesh}, {"unit", unit_json(store.unit())}};
    const std::string like = mesh_name(0, labels.format);
    if (makes_detail_levels(labels)) {
        result.json["frame"] = result.json["space"] = frame_json(store.frame());
    } else {
        add_space_json(store.frame(), a, like, result.json);
    }
    write_label_list(folder / "labels.json", result.json, list, smooth ? &neighbours : nullptr);
    result.json["labels"] = std::move(list);
    if (smooth) {
        result.json["scratch_bytes"] = scratch;  // describes the run, not its result
    }
    result.text =
        fmt::format("{}: {} meshes of {} labels, {} triangles; listed in {}\n", a.mesh,
                    labels.format, chosen.size(), triangles, (folder / "labels.json").string());
    if (!makes_detail_levels(labels)) {
        result.text += space_line(store.frame(), a, like);
    }
    if (bound > 0) {
        result.text += fmt::format("each within {:.6g} of the label's surface\n", bound);
    }
    if (!reports.empty() && reports.front().within_budget == false) {
        result.text += "more triangles than asked for: the distance does not allow fewer\n";
    }
    if (smooth) {
        result.text += smooth_text(*smooth) + (components && components->dropped > 0
                                                   ? " except those of dropped components\n"
                                                   : "\n");
    }
    result.text += manifold_text(in_all_meshes(reports));
    if (components) {
        result.text += fmt::format(
            "all labels together have {} components; {} were dropped, with {} triangles, the "
            "largest with {}\n",
            components->components, components->dropped, components->dropped_triangles,
            components->largest_dropped);
    }
    return result;
}

Result extract_labels_together(const Store& store, const LabelArguments& labels,
                               const ExtractArguments& a, const LabelQuery& query,
                               Progress& progress) {
    require_place_for_over(labels);
    const std::vector<Label> chosen =
        chosen_of(find_labels(store, {a.options.memory, a.options.threads}, progress),
                  *labels.several, a.store);
    std::vector<TileFeature> features;
    for (const Label& label : chosen) {
        const LabelName name = store.label_name(label.id).value_or(LabelName{});
        features.push_back({label.id, {}, name.name, name.color});
    }
    MeshOutput output(a, a.file_options(), store.reader().layout().header(), std::move(features));
    const auto place_of = [&](std::int64_t id) {
        const auto at = std::lower_bound(chosen.begin(), chosen.end(), id,
                                         [](const Label& l, std::int64_t i) { return l.id < i; });
        return static_cast<std::size_t>(at - chosen.begin());
    };
    std::vector<ExtractReport> reports(chosen.size());
    extract_labels(
        store, chosen, query, [&](const Label& label) { return output.sink(place_of(label.id)); },
        [&](std::size_t i, const ExtractReport& report) {
            reports[i] = report;
            if (reports[i].smooth) {
                reports[i].smooth->neighbours = {};
            }
        },
        options_of(a), progress);
    Result result;
    Json list = Json::array();
    std::uint64_t triangles = 0;
    ExtractReport furthest;
    for (std::size_t i = 0; i < chosen.size(); ++i) {
        list.push_back(json_of(store, chosen[i], reports[i], a.mesh));
        triangles += reports[i].triangles;
        if (i == 0 || (reports[i].distance && furthest.distance &&
                       reports[i].distance->bound > furthest.distance->bound)) {
            furthest = reports[i];
        }
    }
    result.json = {{makes_tiles(a) ? "folder" : "mesh", a.mesh}, {"unit", unit_json(store.unit())}};
    add_space_json(store.frame(), a, a.mesh, result.json);
    result.json["labels"] = std::move(list);
    result.text = fmt::format("{}: {} labels, {} triangles\n{}", a.mesh, chosen.size(), triangles,
                              space_line(store.frame(), a, a.mesh));
    if (furthest.smooth) {
        result.text += smooth_text(*furthest.smooth) + "\n";
    }
    result.text += manifold_text(in_all_meshes(reports));
    output.finish(furthest, progress, result);
    return result;
}

namespace {

/// The file for the interfaces of some labels.
std::unique_ptr<MeshSink> open_interfaces(const Store& store, std::span<const Label> labels,
                                          const ExtractArguments& a) {
    const MeshFileOptions file = a.file_options();
    if (!is_mesher_file(a.mesh)) {
        return open_mesh_file(a.mesh, file);
    }
    MesherFileOptions options{file.replace, file.space, file.unit, {}, options_of(a).scratch};
    for (const Label& label : labels) {
        options.labels.push_back(store.label_name(label.id).value_or(LabelName{}));
        options.labels.back().id = label.id;
    }
    return open_mesher_file(a.mesh, options);
}

/// The command that makes tetrahedra; empty for other files.
std::string mesher_text(const std::string& mesh) {
    if (!is_mesher_file(mesh)) {
        return "";
    }
    fs::path script = mesh;
    return lower_extension(mesh) == ".msh"
               ? fmt::format("gmsh -3 {} makes tetrahedra of it\n",
                             script.replace_extension(".geo").string())
               : fmt::format("tetgen -pA {} makes tetrahedra of it\n", mesh);
}

}  // namespace

Result extract_label_interfaces(const Store& store, const LabelArguments& labels,
                                const ExtractArguments& a, const LabelQuery& query,
                                Progress& progress) {
    if (!labels.smooth) {
        throw Error(ErrorKind::invalid_argument, {a.store},
                    "--interfaces needs --smooth; --smooth=0 keeps the faces of the voxels");
    }
    std::unique_ptr<MeshSink> sink;
    const auto open = [&](std::span<const Label> chosen) {
        sink = with_fields(a.fields, open_interfaces(store, chosen, a));
        MeshLayout layout;
        layout.unit = store.unit();
        layout.frame = store.frame();
        layout.has_sides = true;
        const fs::path input = a.store;
        sink->prepare(layout, std::span(&input, 1));
    };
    // Fails early if the format cannot hold the attributes of the mesh.
    open({});
    const std::vector<Label> chosen =
        chosen_of(find_labels(store, {a.options.memory, a.options.threads}, progress),
                  *labels.several, a.store);
    if (is_mesher_file(a.mesh)) {
        open(chosen);
    }
    // The maximum number of labels listed in a report; if there are more, only their number is
    // reported.
    constexpr std::uint64_t kMaxListed = 10000;
    std::vector<LabelInterface> interfaces;
    const ExtractReport r = extract_interfaces(
        store, chosen, query, *sink,
        [&](const LabelInterface& one) {
            if (interfaces.size() <= kMaxListed) {
                interfaces.push_back(one);
            }
        },
        options_of(a), progress);
    Result result;
    result.warning = extract_warning(a, r);
    result.json = extract_json(a, r);
    result.json.erase("volume");
    result.json["unit"] = unit_json(store.unit());
    add_space_json(store.frame(), a, a.mesh, result.json);
    add_smooth_json(*r.smooth, result.json);
    add_distance_json(result.json, r);
    result.json["outside"] = r.interfaces->outside;
    result.json["interface_count"] = r.interfaces->interfaces;
    result.json["interfaces"] = nullptr;
    if (r.interfaces->interfaces <= kMaxListed) {
        result.json["interfaces"] = Json::array();
        for (const LabelInterface& one : interfaces) {
            result.json["interfaces"].push_back(
                {{"labels", {one.behind, one.in_front}}, {"area", one.area}});
        }
    }
    const std::string unit = unit_suffix(store.unit());
    result.text = fmt::format(
        "{}: {} triangles, {} vertices, of {} interfaces of {} labels, in {}\n{}{}\narea "
        "{:.6g}{}; each triangle faces from the smaller of its two labels to the larger one, or to "
        "{}, which means no label\n",
        a.mesh, r.triangles, r.vertices, r.interfaces->interfaces, chosen.size(),
        human_seconds(r.seconds), sheets_text(r, unit), smooth_text(*r.smooth), r.measures->area,
        unit.empty() ? "" : unit + "2", r.interfaces->outside);
    result.text += version_text(a.mesh) + mesher_text(a.mesh);
    if (r.closing) {
        add_close_json(*r.closing, result.json);
        result.text += "closed at the outer faces of the voxels at the volume's border\n";
    }
    return result;
}

}  // namespace isonest::detail::cli
