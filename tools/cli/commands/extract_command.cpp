#include "tools/cli/commands/extract_command.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <utility>

#include <isonest/error.h>
#include <isonest/march.h>
#include <isonest/mesh_file.h>

#include "query/extract/combinations.h"
#include "store/remote/open_location.h"
#include "tools/cli/options/label_names.h"
#include "tools/cli/options/source_options.h"
#include "tools/cli/options/surface_options.h"
#include "tools/cli/options/tile_output.h"
#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

/// "The surface is empty: every value is below 300; values are 0 to 255."
std::string range_of_empty(VolumeSource& volume, double iso, const ExtractOptions& options,
                           Progress& progress) {
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    const auto [low, high] =
        finite_range(volume, options, progress).value_or(std::pair{kNone, kNone});
    if (!(low <= high)) {
        return "The surface is empty: all values are missing.\n";
    }
    return fmt::format("The surface is empty: {}; values are {}.\n",
                       iso <= low ? fmt::format("no value is below {}", iso)
                       : high < iso
                           ? fmt::format("every value is below {}", iso)
                           : fmt::format("values cross {} only next to missing values", iso),
                       human_range(low, high));
}

/// Explains why there is no surface. Reads the volume once more; a volume that can only be read in
/// order is reopened, unless it is a pipe or a URL.
std::string empty_volume(VolumeSource& volume, const InputArguments& in, double iso,
                         const ExtractOptions& options, Progress& progress) {
    if (volume.sequential()) {
        const bool is_file =
            std::none_of(in.input.begin(), in.input.end(),
                         [](const std::string& name) { return name == "-" || is_url(name); });
        if (!is_file) {
            return fmt::format("The surface is empty: no cell has values on both sides of {}.\n",
                               iso);
        }
        const std::unique_ptr<VolumeSource> again =
            open_input(in.input, options.scratch, in.source);
        return range_of_empty(*again, iso, options, progress);
    }
    return range_of_empty(volume, iso, options, progress);
}

}  // namespace

namespace {

/// Rejects outputs in which --manifold has no effect.
void require_shared_vertices(const ExtractArguments& a, const std::string& format) {
    if (makes_tiles(a)) {
        throw Error(ErrorKind::invalid_argument, {a.mesh},
                    "--manifold: 3D Tiles are cut into cubes, which separates vertices anyway");
    }
    if (format == "stl" || lower_extension(a.mesh) == ".stl") {
        throw Error(ErrorKind::invalid_argument, {a.mesh},
                    "--manifold: triangles of .stl share no vertices, so programs that read it "
                    "join what was separated; write another format");
    }
}

}  // namespace

bool ExtractCommand::is_simplified() const {
    return !extract.is_graph && effort_of(features_of(surface_query(nullptr))) != Effort::none;
}

SurfaceQuery ExtractCommand::surface_query(const Store* others) const {
    const ExtractArguments& a = extract;
    auto query = begun<SurfaceQuery>(others);
    query.iso = isovalues.one();
    query.grid = {a.cells, vertices, bound, culling};
    if (distance.by_error && distance.distance) {
        throw Error(ErrorKind::invalid_argument,
                    "--by error and --distance cannot be combined: --triangles minimises either "
                    "the error or the distance");
    }
    query.stop = distance.stop().value_or(query.stop);
    query.effort = distance.effort;
    if (manifold) {
        require_shared_vertices(a, labels.has_format ? labels.format : "");
    }
    query.stages = {close, components, manifold};
    if (distance.analysis && !distance.stop()) {
        throw Error(ErrorKind::invalid_argument, "--keep-analysis needs --distance or --triangles");
    }
    query.analysis = distance.analysis;
    query.volume_interval = volume_interval;
    return query;
}

std::optional<Store> open_values(ExtractCommand& arguments, Progress& progress) {
    std::optional<Store> others;
    if (!arguments.values.empty()) {
        others.emplace(open_required_store(arguments.values, arguments.in.remote,
                                           arguments.extract.options.memory, progress,
                                           arguments.in.input.front()));
    }
    return others;
}

bool needs_no_store(VolumeSource& volume, const ExtractCommand& arguments, bool has_iso) {
    const LabelArguments& labels = arguments.labels;
    if (!arguments.in.keep.empty() || !has_iso || arguments.extract.is_graph || labels.one ||
        labels.several || labels.smooth || labels.keep_nodes || !arguments.values.empty() ||
        !arguments.extract.color_map.empty() || arguments.isovalues.all.size() > 1 ||
        arguments.extract.error.indicator != ErrorIndicator::deviation) {
        return false;
    }
    return march_memory(volume, arguments.surface_query(nullptr)).has_value();
}

Result extract_from_volume(VolumeSource& volume, ExtractCommand arguments, Progress& progress) {
    ExtractArguments& a = arguments.extract;
    a.mesh = mesh_name(a.mesh, arguments.isovalues.texts.front());
    const ExtractOptions options = options_of(a);
    const VolumeDescription description = volume.describe();
    arguments.distance.resolve(description.unit, description.name);
    const SurfaceQuery query = arguments.surface_query(nullptr);
    MeshOutput output(a, a.file_options(), header_of(description));
    const ExtractReport report = isonest::extract(volume, query, *output.sink(), options, progress);
    ExtractOrigin origin{nullptr, &volume, description.unit, description.frame, {}};
    if (report.triangles == 0) {
        origin.why_empty = empty_volume(volume, arguments.in, query.iso, options, progress);
    }
    Result result = result_of(origin, arguments, report);
    add_fetched(volume, result);
    output.finish(report, progress, result);
    return result;
}

namespace {

/// Explains why there is no surface.
std::string empty_surface(const Store& store, const ExtractCommand& arguments,
                          const ExtractReport& r) {
    const ExtractArguments& a = arguments.extract;
    const double iso = arguments.isovalues.one();
    const std::string range = range_text(store);
    if (arguments.labels.one) {
        return fmt::format("No node, or every node, has the label {}{}{}; the values are {}.\n",
                           *arguments.labels.one, label_name_text(store, *arguments.labels.one),
                           a.box ? " in the box" : "", range);
    }
    if (!(store.min_value() <= store.max_value())) {
        return "The surface is empty: all values are missing.\n";
    }
    // A closed surface bounds a solid, which may fill the whole volume.
    const bool some_below = store.min_value() < iso || arguments.close == Outside::below;
    const bool some_above = iso <= store.max_value() || arguments.close == Outside::above;
    if (!a.is_graph && !(some_below && some_above)) {
        return fmt::format("The surface is empty: {} value is below {}; values are {}.\n",
                           iso <= store.min_value() ? "no" : "every", iso, range);
    }
    if (a.box && !reaches_volume(store, *a.box)) {
        return "The surface is empty: the box lies outside of the volume, " + volume_text(store) +
               ".\n";
    }
    const std::string inside = a.box ? " inside the box" : "";
    if (r.tolerance > 0 || a.camera) {
        return fmt::format(
            "There is no surface{} at this tolerance; a smaller one may show some. The values are "
            "{}.\n",
            inside, range);
    }
    return fmt::format("The surface is empty{}: the values are {}{}.\n", inside, range,
                       a.box ? " in the whole volume" : "");
}

/// "read 3 of 8 chunks, 1.2 MB".
std::string read_text(const TraversalReport& r) {
    return fmt::format("read {} of {} chunks, {}", r.chunks_read, r.chunks_total,
                       human_bytes(static_cast<double>(r.bytes_read)));
}

/// "area 12.5 mm2, volume 3.25 mm3".
std::string measures_text(std::optional<LengthUnit> of, const SurfaceMeasures& m) {
    const std::string unit = unit_suffix(of);
    const auto power = [&](int p) { return unit.empty() ? "" : fmt::format("{}{}", unit, p); };
    return fmt::format("area {:.6g}{}, {}\n", m.area, power(2),
                       m.volume ? fmt::format("volume {:.6g}{}", *m.volume, power(3))
                                : "not closed, so it has no volume");
}

/// The interval that contains the enclosed volume at full resolution.
std::string interval_text(std::optional<LengthUnit> of, const VolumeInterval& v) {
    const std::string unit = unit_suffix(of);
    return fmt::format("volume at full resolution between {:.6g} and {:.6g}{}\n", v.least, v.most,
                       unit.empty() ? "" : unit + "3");
}

}  // namespace

Result result_of(const ExtractOrigin& origin, const ExtractCommand& arguments,
                 const ExtractReport& r) {
    const ExtractArguments& a = arguments.extract;
    const LabelArguments& labels = arguments.labels;
    const bool has_iso = !arguments.isovalues.all.empty();
    Result result;
    result.warning = extract_warning(a, r);
    result.json = extract_json(a, r);
    add_distance_json(result.json, r);
    result.json["unit"] = unit_json(origin.unit);
    add_space_json(origin.frame, a, a.mesh, result.json);
    if (origin.volume != nullptr) {
        result.json["without_store"] = true;
        result.json["notes"] = origin.volume->notes();
    }
    if (has_iso) {
        result.json["iso"] = arguments.isovalues.one();
    }
    if (labels.one) {
        result.json["label"] = *labels.one;
        if (origin.store != nullptr) {
            add_label_name(*origin.store, *labels.one, result.json);
        }
    }
    if (r.smooth) {
        add_smooth_json(*r.smooth, result.json);
        result.json["scratch_bytes"] = r.scratch_bytes;
        result.json["neighbours"] = Json::array();
        for (const NeighbourLabel& neighbour : r.smooth->neighbours) {
            result.json["neighbours"].push_back({{"id", neighbour.id}, {"area", neighbour.area}});
        }
    }
    result.text =
        fmt::format("{}: {} {}, {} vertices, in {}\n{}; {}\n", a.mesh, r.triangles,
                    r.dimension == 2 && !a.is_graph ? "line segments" : "triangles", r.vertices,
                    human_seconds(r.seconds),
                    r.smooth ? sheets_text(r, unit_suffix(origin.unit)) + smooth_text(*r.smooth)
                    : r.distance || r.within_budget
                        ? distance_text(arguments.distance, r) + (r.distance ? rounded_text(r) : "")
                        : guarantee_text(a, r) + simplified_text(r),
                    origin.volume != nullptr ? "directly from " + origin.volume->describe().name
                                             : read_text(r.traversal));
    result.text += analysis_text(r) + version_text(a.mesh) + space_line(origin.frame, a, a.mesh);
    if (r.measures && r.triangles > 0) {
        result.text += measures_text(origin.unit, *r.measures);
        if (r.distance && r.distance->full) {
            result.text += "at full resolution: " + measures_text(origin.unit, *r.distance->full);
        }
    }
    if (r.volume_interval) {
        result.json["full_volume_interval"] = {r.volume_interval->least, r.volume_interval->most};
        result.text += interval_text(origin.unit, *r.volume_interval);
    } else if (arguments.volume_interval) {
        result.json["full_volume_interval"] = nullptr;
    }
    if (r.components) {
        add_component_json(*r.components, result.json);
        result.text += component_text(r);
    }
    if (r.closing) {
        add_close_json(*r.closing, result.json);
        if (r.triangles > 0) {
            result.text +=
                r.smooth ? smooth_close_text() : close_text(*r.closing, a.box.has_value());
        }
    }
    if (r.triangles == 0 && (!r.components || r.components->dropped == 0)) {
        result.text +=
            origin.store != nullptr ? empty_surface(*origin.store, arguments, r) : origin.why_empty;
    }
    result.text += manifold_text(r);
    if (r.mending.mended > 0) {
        result.text +=
            fmt::format("{} triangles that degenerate in 32-bit floats were removed or repaired.\n",
                        r.mending.mended);
    }
    if (r.mending.zero_area > 0) {
        result.text += fmt::format(
            "{} triangles have no area and cannot be repaired without opening the mesh.\n",
            r.mending.zero_area);
    }
    if (r.apart.together > 0) {
        result.text +=
            fmt::format("{} vertices coincide with others: 32-bit floats cannot separate them.\n",
                        r.apart.together);
    }
    if (r.quality && r.triangles > 0) {
        constexpr double kPercent = 100;
        result.text += fmt::format(
            "Smallest angle of each triangle: minimum {:.2g} degrees, median {:.3g}; {:.2g} % are "
            "below {}.\n",
            r.quality->least, r.quality->median, kPercent * r.quality->narrow_share,
            TriangleQuality::kNarrow);
    }
    for (const std::string& note :
         origin.volume != nullptr ? origin.volume->notes() : std::vector<std::string>{}) {
        result.text += fmt::format("note: {}\n", note);
    }
    return result;
}

}  // namespace isonest::detail::cli
