#include "tools/cli/options/tile_output.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <system_error>
#include <utility>

#include <isonest/error.h>

#include "store/base/vectors.h"
#include "store/files/output_file.h"
#include "tools/cli/options/units.h"
#include "tools/cli/terminal/interrupt.h"

namespace isonest::detail::cli {
namespace {

Georeference parse_georeference(const std::string& text) {
    const bool has_height = std::count(text.begin(), text.end(), ',') == 2;
    const std::vector<double> numbers = parse_numbers("--georeference", text, has_height ? 3 : 2,
                                                      has_height ? "LON,LAT,HEIGHT" : "LON,LAT");
    return {numbers[0], numbers[1], has_height ? numbers[2] : 0};
}

/// The surface from which errors are measured.
TilesetSource source_of(const ExtractReport& r) {
    TilesetSource source;
    if (r.distance) {
        source.bound = r.distance->bound;
    } else if (r.tolerance > 0 || r.within_budget) {
        source.surface = r.error_bound > 0
                             ? fmt::format(
                                   "the extracted surface, whose values are within {:.6g} of the "
                                   "isovalue",
                                   r.error_bound)
                             : "the extracted surface";
    }
    return source;
}

Json json_of(const TilesetReport& r, const TilesetSource& source) {
    Json levels = Json::array();
    for (const TileLevel& level : r.levels) {
        levels.push_back({{"distance_bound", level.bound},
                          {"tiles", level.tiles},
                          {"triangles", level.triangles},
                          {"bytes", level.bytes},
                          {"without_mesh", level.without_mesh}});
    }
    return {{"levels", levels},
            {"files", r.files},
            {"bytes", r.bytes},
            {"errors_are_from", source.surface},
            {"scratch_bytes", r.scratch_bytes}};
}

/// The colour of a value. REQUIRES: low < high.
LabelColor color_of(const VertexColors& colors, double value) {
    const double part = (value - colors.low) / (colors.high - colors.low);
    const auto last = static_cast<double>(colors.map.size() - 1);
    return colors.map[static_cast<std::size_t>(std::lround(std::clamp(part, 0.0, 1.0) * last))];
}

/// Objects with the names and colours of the features. Colours by isovalue become colours of the
/// objects, and the vertices get none.
std::vector<MeshObject> objects_of(const std::vector<TileFeature>& features,
                                   MeshFileOptions& options) {
    std::vector<MeshObject> objects;
    const bool by_isovalue = options.colors && options.colors->attribute == "isovalue";
    for (const TileFeature& feature : features) {
        MeshObject object{feature.name, feature.color};
        if (object.title.empty()) {
            object.title = feature.label ? fmt::format("label {}", *feature.label)
                                         : fmt::format("isovalue {}", *feature.isovalue);
        }
        if (by_isovalue) {
            object.color = color_of(*options.colors, *feature.isovalue);
        }
        objects.push_back(std::move(object));
    }
    if (by_isovalue) {
        options.colors.reset();
    }
    return objects;
}

}  // namespace

void add_tile_options(CLI::App* command, ExtractArguments& a) {
    add_parsed(command, "--georeference",
               [&a](const std::string& text) { a.georeference = parse_georeference(text); });
}

bool makes_objects(const std::string& mesh, const std::string& format) {
    std::error_code ignored;
    return MeshCollection::is_supported(mesh) && !std::filesystem::is_directory(mesh, ignored) &&
           (format.empty() || lower_extension(mesh) == "." + format);
}

std::string folder_name(std::string name) {
    while (name.size() > 1 && name.back() == '/') {
        name.pop_back();
    }
    return name;
}

void set_lattice(const StoreHeader& header, const std::optional<std::array<double, 2>>& heights,
                 TilesetOptions& options) {
    require_not_curved(header, {}, "a tileset");
    const LatticeSteps steps = header.steps();
    options.origin = header.origin;
    options.axes = header.rotation();
    options.spacing = steps.along;
    for (unsigned corner = 0; corner < 8; ++corner) {
        Double3 at{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const auto nodes = static_cast<double>(header.nodes[static_cast<int>(axis)]);
            at[axis] = (corner >> axis & 1U) != 0 ? nodes - 0.5 : -0.5;
        }
        at = steps.vector(at);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const double node = at[axis] / steps.along[axis];
            options.first[axis] = std::min(corner == 0 ? node : options.first[axis], node);
            options.last[axis] = std::max(corner == 0 ? node : options.last[axis], node);
        }
    }
    if (heights) {
        options.spacing[2] = std::min(options.spacing[0], options.spacing[1]);
        options.origin[2] = 0;
        options.first[2] = heights->at(0) / options.spacing[2];
        options.last[2] = heights->at(1) / options.spacing[2];
    }
}

MeshOutput::MeshOutput(const ExtractArguments& a, const MeshFileOptions& file,
                       const StoreHeader& header, std::vector<TileFeature> features,
                       std::optional<std::array<double, 2>> heights)
    : mesh_(a.mesh), file_(file), fields_(a.fields), unit_(unit_suffix(header.unit)) {
    if (!makes_tiles(a)) {
        if (!features.empty()) {
            MeshFileOptions options = file;
            std::vector<MeshObject> objects = objects_of(features, options);
            collection_ = std::make_unique<MeshCollection>(mesh_, std::move(objects), options,
                                                           options_of(a).scratch);
        }
        return;
    }
    if (a.mesh_unit) {
        throw Error(ErrorKind::invalid_argument, {a.mesh},
                    "--mesh-unit: 3D Tiles are always in metres if the unit of the coordinates is "
                    "known");
    }
    TilesetOptions options;
    options.replace = file.replace;
    set_lattice(header, heights, options);
    options.features = std::move(features);
    options.title = file.title;
    options.color = file.color;
    options.space = file.space;
    options.colors = file.colors;
    options.georeference = a.georeference;
    options.memory = a.options.memory;
    options.threads = a.options.threads;
    options.scratch = options_of(a).scratch;
    tileset_ = std::make_unique<Tileset>(mesh_, options);
}

std::unique_ptr<MeshSink> MeshOutput::sink(std::size_t feature) {
    std::unique_ptr<MeshSink> made = tileset_      ? tileset_->sink(feature)
                                     : collection_ ? collection_->sink(feature)
                                                   : open_mesh_file(mesh_, file_);
    return with_fields(fields_, std::move(made));
}

void MeshOutput::finish(const ExtractReport& r, Progress& progress, Result& result) {
    if (collection_) {
        collection_->finish(progress);
    }
    if (!tileset_) {
        return;
    }
    const TilesetSource source = source_of(r);
    const TilesetReport report = tileset_->finish(source, progress);
    result.json["tileset"] = json_of(report, source);
    if (const std::string left = leftovers_of(mesh_); !left.empty()) {
        result.warning += (result.warning.empty() ? "" : "\n") + left;
    }
    std::uint64_t tiles = 0;
    std::uint64_t without = 0;
    for (const TileLevel& level : report.levels) {
        tiles += level.tiles;
        without += level.without_mesh;
    }
    result.text += fmt::format(
        "{}: 3D Tiles, {} tiles in {} levels, {} in {} files; errors are from {}\n",
        (std::filesystem::path(mesh_) / "tileset.json").string(), tiles, report.levels.size(),
        human_bytes(static_cast<double>(report.bytes)), report.files, source.surface);
    for (std::size_t i = 0; i < report.levels.size(); ++i) {
        const TileLevel& level = report.levels[i];
        if (level.tiles == 0) {
            continue;
        }
        result.text += fmt::format(
            "  level {}: {} triangles in {} tiles, {}, within {:.4g}{}\n", i, level.triangles,
            level.tiles, human_bytes(static_cast<double>(level.bytes)), level.bound, unit_);
    }
    if (without > 0) {
        result.text += fmt::format(
            "{} tiles have no mesh, because too many of their triangles cannot be simplified; "
            "viewers load the tiles below them\n",
            without);
    }
}

}  // namespace isonest::detail::cli
