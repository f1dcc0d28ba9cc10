// isonest extract: from a store to an isosurface mesh.
#include <fmt/format.h>

#include <memory>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/joined_isovalues.h>
#include <isonest/mesh_file.h>

#include "tools/cli/command.h"
#include "tools/cli/options/close_option.h"
#include "tools/cli/options/component_options.h"
#include "tools/cli/options/distance_options.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/options/fields.h"
#include "tools/cli/options/isovalue_option.h"
#include "tools/cli/options/label_options.h"
#include "tools/cli/options/units.h"

namespace isonest::detail::cli {
namespace {

struct Arguments {
    ExtractArguments extract;
    Isovalues isovalues;
    double scale = 1;  ///< of the graph
    std::optional<Field> bound;
    std::optional<BackfaceCulling> culling;
    DistanceArguments distance;
    std::optional<ComponentChoice> components;
    std::optional<Outside> close;
    bool volume_interval = false;
    VertexPlace vertices = VertexPlace::linear;
    std::string values;  ///< a second store, or empty
    LabelArguments labels;
};

/// REQUIRES: the option needs --view.
BackfaceCulling& culling_of(Arguments& a) {
    if (!a.culling) {
        a.culling.emplace();
    }
    return *a.culling;
}

VertexPlace parse_vertices(const std::string& text) {
    if (text != "linear" && text != "exact") {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("--vertices '{}': give linear or exact", text));
    }
    return text == "exact" ? VertexPlace::exact : VertexPlace::linear;
}

/// Why there is none.
std::string empty_surface(const Store& store, const Arguments& arguments, const ExtractReport& r) {
    const ExtractArguments& a = arguments.extract;
    const double iso = arguments.isovalues.one();
    const std::string range = human_range(store.min_value(), store.max_value());
    if (arguments.labels.one) {
        return fmt::format(
            "There is no node with the label {}{}, or no other one: the values are "
            "{}.\n",
            *arguments.labels.one, a.box ? " in the box" : "", range);
    }
    if (!(store.min_value() <= store.max_value())) {
        return "The surface is empty: all values are missing.\n";
    }
    // What is closed is a solid, and may fill the whole volume.
    const bool some_below = store.min_value() < iso || arguments.close == Outside::below;
    const bool some_above = iso <= store.max_value() || arguments.close == Outside::above;
    if (!a.is_graph && !(some_below && some_above)) {
        return fmt::format("The surface is empty: {} value is below {}; they are {}.\n",
                           iso <= store.min_value() ? "no" : "every", iso, range);
    }
    if (a.box && !reaches_volume(store, *a.box)) {
        return "The surface is empty: the box lies outside of the volume, " + volume_text(store) +
               ".\n";
    }
    const std::string inside = a.box ? " inside the box" : "";
    if (r.tolerance > 0 || a.camera) {
        return fmt::format(
            "There is no surface{} that is coarse enough for the tolerance: a smaller one may show "
            "some. The values are {}.\n",
            inside, range);
    }
    return fmt::format("The surface is empty{}: the values are {}{}.\n", inside, range,
                       a.box ? " in the whole volume" : "");
}

/// What surfaces and graphs have.
template <class Query>
Query begun_query(const Arguments& arguments, const Store* values) {
    const ExtractArguments& a = arguments.extract;
    auto query = a.query<Query>();
    query.attributes = {a.normals, values, a.vertex_error};
    return query;
}

GraphQuery graph_query(const Arguments& arguments, const Store* values) {
    auto query = begun_query<GraphQuery>(arguments, values);
    query.scale = arguments.scale;
    query.cells = arguments.extract.cells.value_or(Cells::tetrahedra);
    return query;
}

SurfaceQuery surface_query(const Arguments& arguments, const Store* values) {
    const ExtractArguments& a = arguments.extract;
    auto query = begun_query<SurfaceQuery>(arguments, values);
    query.iso = arguments.isovalues.one();
    query.grid = {a.cells, arguments.vertices, arguments.bound, arguments.culling};
    if (arguments.distance.by_error && arguments.distance.distance) {
        throw Error(ErrorKind::invalid_argument,
                    "--by error goes without --distance: the triangles are the nested grid's");
    }
    if (arguments.distance.simplify && !arguments.distance.by_error) {
        if (a.error.value == 0) {
            throw Error(ErrorKind::invalid_argument,
                        "--simplify goes with --error or --error-relative, above 0, or with "
                        "--triangles N --by error; --distance simplifies by itself");
        }
        query.stop = SimplifiedErrorBound{a.error};
    }
    arguments.distance.require_sense();
    query.stop = arguments.distance.stop().value_or(query.stop);
    query.stages = {arguments.close, arguments.components};
    if (arguments.distance.analysis && !arguments.distance.stop()) {
        throw Error(ErrorKind::invalid_argument,
                    "--keep-analysis goes with --distance or --triangles");
    }
    query.analysis = arguments.distance.analysis;
    query.volume_interval = arguments.volume_interval;
    return query;
}

ExtractReport run_query(const Store& store, const Arguments& arguments, const Store* values,
                        Progress& progress) {
    const ExtractArguments& a = arguments.extract;
    const std::unique_ptr<MeshSink> sink = open_mesh_file(a.mesh, {.replace = true});
    if (a.is_graph) {
        return extract(store, graph_query(arguments, values), *sink, options_of(a), progress);
    }
    const SurfaceQuery query = surface_query(arguments, values);
    return arguments.labels.one ? extract(store, label_query(query, {*arguments.labels.one}), *sink,
                                          options_of(a), progress)
                                : extract(store, query, *sink, options_of(a), progress);
}

/// "area 12.5 mm2, volume 3.25 mm3".
std::string measures_text(const Store& store, const SurfaceMeasures& m) {
    const std::string unit = unit_suffix(store);
    const auto power = [&](int p) { return unit.empty() ? "" : fmt::format("{}{}", unit, p); };
    return fmt::format("area {:.6g}{}, {}\n", m.area, power(2),
                       m.volume ? fmt::format("volume {:.6g}{}", *m.volume, power(3))
                                : "not closed, so it has no volume");
}

/// Between which volumes that at full resolution lies.
std::string interval_text(const Store& store, const VolumeInterval& v) {
    const std::string unit = unit_suffix(store);
    return fmt::format("volume at full resolution between {:.6g} and {:.6g}{}\n", v.least, v.most,
                       unit.empty() ? "" : unit + "3");
}

/// What is said of one mesh.
Result result_of(const Store& store, const Arguments& arguments, const ExtractReport& r) {
    const ExtractArguments& a = arguments.extract;
    const LabelArguments& labels = arguments.labels;
    const bool has_iso = !arguments.isovalues.all.empty();
    Result result;
    result.warning = extract_warning(a, r);
    result.json = extract_json(a, r);
    add_distance_json(result.json, r);
    result.json["unit"] = unit_json(store.unit());
    if (has_iso) {
        result.json["iso"] = arguments.isovalues.one();
    }
    if (labels.one) {
        result.json["label"] = *labels.one;
    }
    result.text =
        fmt::format("{}: {} {}, {} vertices, in {}\n{}; read {} of {} chunks, {}\n", a.mesh,
                    r.triangles, r.dimension == 2 && !a.is_graph ? "line segments" : "triangles",
                    r.vertices, human_seconds(r.seconds),
                    r.distance || r.within_budget ? distance_text(arguments.distance, r)
                                                  : guarantee_text(a, r) + simplified_text(r),
                    r.traversal.chunks_read, r.traversal.chunks_total,
                    human_bytes(static_cast<double>(r.traversal.bytes_read)));
    result.text += analysis_text(r) + version_text(a.mesh);
    if (r.measures && r.triangles > 0) {
        result.text += measures_text(store, *r.measures);
        if (r.distance && r.distance->full) {
            result.text += "at full resolution: " + measures_text(store, *r.distance->full);
        }
    }
    if (r.volume_interval) {
        result.json["full_volume_interval"] = {r.volume_interval->least, r.volume_interval->most};
        result.text += interval_text(store, *r.volume_interval);
    } else if (arguments.volume_interval) {
        result.json["full_volume_interval"] = nullptr;
    }
    if (r.components) {
        add_component_json(*r.components, result.json);
        result.text += component_text(r);
    }
    if (r.closing) {
        add_close_json(*r.closing, result.json);
        result.text += r.triangles > 0 ? close_text(*r.closing, a.box.has_value()) : "";
    }
    if (r.triangles == 0 && (!r.components || r.components->dropped == 0)) {
        result.text += empty_surface(store, arguments, r);
    }
    if (r.mending.mended > 0) {
        result.text += fmt::format(
            "{} triangles whose corners 32-bit floats round to one place or line were taken out or "
            "mended.\n",
            r.mending.mended);
    }
    if (r.mending.zero_area > 0) {
        result.text += fmt::format(
            "{} triangles have no area; nothing that keeps the mesh whole "
            "mends them.\n",
            r.mending.zero_area);
    }
    if (r.apart.together > 0) {
        result.text += fmt::format(
            "{} vertices lie in the places of others: 32-bit floats have no other place for "
            "them.\n",
            r.apart.together);
    }
    if (r.quality && r.triangles > 0) {
        constexpr double kPercent = 100;
        result.text += fmt::format(
            "Smallest angles of the triangles: {:.2g} degrees at least, {:.3g} in the middle; "
            "{:.2g} % are below {}.\n",
            r.quality->least, r.quality->median, kPercent * r.quality->narrow_share,
            TriangleQuality::kNarrow);
    }
    return result;
}

/// A mesh for each isovalue, or one with all of them.
Result run_isovalues(const Store& store, const Arguments& arguments, const Store* values,
                     Progress& progress) {
    const Isovalues& isovalues = arguments.isovalues;
    const std::string& mesh = arguments.extract.mesh;
    const bool in_one = !is_own_name(mesh);
    std::vector<Arguments> each(isovalues.all.size(), arguments);
    for (std::size_t i = 0; i < each.size(); ++i) {
        each[i].extract.mesh = mesh_name(mesh, isovalues.texts[i]);
        each[i].isovalues = {{isovalues.all[i]}, {isovalues.texts[i]}};
    }
    Result all;
    all.json = {{"meshes", Json::array()}};
    const auto done = [&](std::size_t i, const ExtractReport& r) {
        Result result = result_of(store, each[i], r);
        all.json["meshes"].push_back(std::move(result.json));
        all.text += in_one ? fmt::format("isovalue {} in ", isovalues.texts[i]) : "";
        all.text += result.text;
        if (!result.warning.empty()) {
            all.warning += (all.warning.empty() ? "" : "\n") + result.warning;
        }
    };
    const SurfaceQuery query = surface_query(arguments, values);
    const ExtractOptions options = options_of(arguments.extract);
    if (in_one) {
        require_place_for_isovalue(mesh);
        const std::unique_ptr<MeshSink> sink = open_mesh_file(mesh, {.replace = true});
        extract_joined(store, isovalues.all, query, *sink, done, options, progress);
    } else {
        extract_isovalues(
            store, isovalues.all, query,
            [&](std::size_t i) { return open_mesh_file(each[i].extract.mesh, {.replace = true}); },
            done, options, progress);
    }
    return all;
}

Result run(const Arguments& given, bool has_iso, Progress& progress) {
    Arguments arguments = given;
    const ExtractArguments& a = arguments.extract;
    require_suitable_cells(a);
    const Store store(a.store);
    arguments.distance.resolve(store);
    std::optional<Store> others;
    if (!arguments.values.empty()) {
        others.emplace(arguments.values);
    }
    const Store* const values = others ? &*others : nullptr;
    const LabelArguments& labels = arguments.labels;
    if (labels.several) {
        return extract_label_meshes(store, labels, a,
                                    label_query(surface_query(arguments, values), {}), progress);
    }
    if (!has_iso && !a.is_graph && !labels.one) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("give the isovalue, --iso V, or a --label; the values of {} are {}",
                                a.store, human_range(store.min_value(), store.max_value())));
    }
    if (arguments.isovalues.all.size() > 1) {
        return run_isovalues(store, arguments, values, progress);
    }
    Arguments own = arguments;
    if (has_iso) {
        own.extract.mesh = mesh_name(a.mesh, arguments.isovalues.texts.front());
    }
    return result_of(store, own, run_query(store, own, values, progress));
}

/// What usually comes, and how long it takes beside the rest.
std::vector<ProgressStage> stages_of(const Arguments& a) {
    std::vector<ProgressStage> stages;
    if (a.labels.several) {
        return {{"find labels", "finding the labels", 0.2}, {"extract", "extracting", 1}};
    }
    stages.push_back(
        {"extract", a.extract.is_graph ? "making the graph" : "following the surface", 0.6});
    if (a.components) {
        stages.push_back({"find components", "finding the pieces", 0.3});
        stages.push_back({"drop components", "dropping small pieces", 0.1});
    }
    if (a.distance.distance || a.distance.triangles > 0 || a.distance.simplify) {
        stages.push_back({"simplify", "simplifying", 5});
    }
    stages.push_back({"write mesh", "writing the mesh", 0.4});
    return stages;
}

}  // namespace

void add_extract(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<Arguments>();
    CLI::App* const c = add_command(
        app, chosen, "extract",
        {"Write an isosurface of a store as a mesh, with a guaranteed error",
         "The mesh is crack-free, and nowhere further from the isovalue than the error says. A "
         "larger\n"
         "error gives fewer triangles and reads less; error 0 gives the surface at full "
         "resolution.\n"
         "The name of the mesh chooses its format: .ply .stl .obj .vtp .vtkhdf .glb .3mf. Data "
         "in a plane\n"
         "(one node along an axis) give isolines (.vtp .obj), or their graph.",
         "isonest extract scan.isonest --iso 120 -o full.ply\n"
         "isonest extract scan.isonest --iso 120 --error-relative 0.01 -o coarse.glb --normals\n"
         "isonest extract scan.isonest --iso 80,120,160 -o surface_{iso}.ply\n"
         "isonest extract scan.isonest --iso 80,120,160 -o surfaces.vtp\n"
         "isonest extract scan.isonest --iso 120 --distance 0.5voxel -o small.stl\n"
         "isonest extract scan.isonest --iso 120 --error-relative 0.01 --simplify -o light.glb\n"
         "isonest extract scan.isonest --iso 120 --triangles 100000 -o web.glb\n"
         "isonest extract scan.isonest --iso 120.5 --close --components largest -o print.3mf\n"
         "isonest extract cells.isonest --labels all --distance 0.5voxel -o meshes\n"
         "isonest extract scan.isonest --iso 120 --error 2 --box 0,0,0,50,50,20 -o corner.ply\n"
         "isonest extract scan.isonest --iso 120 --error 1 --focus 30,40,20 --falloff 0.1 -o "
         "near.ply\n"
         "isonest extract scan.isonest --iso 120 --stop normal_bar --threshold 0.2 -o smooth.vtp\n"
         "isonest extract map.isonest --iso 500 --error 2 -o contour.vtp\n"
         "isonest extract map.isonest --graph --scale 3 --error 5 -o relief.glb --normals"});
    add_extract_options(c, a->extract);
    CLI::Option* const iso = add_isovalue_option(c, a->isovalues);
    CLI::Option* const graph =
        c->add_flag("--graph", a->extract.is_graph,
                    "of data in a plane: the surface z = value in place of isolines");
    for (CLI::Option* const option : add_component_options(c, a->components)) {
        option->excludes(graph);
    }
    CLI::Option* const close = add_close_option(c, a->close);
    close->excludes(graph);
    c->add_flag("--volume-interval", a->volume_interval,
                "say between which volumes that of the solid at full\n"
                "resolution lies; extracts two more surfaces to know it")
        ->needs(close);
    add_parsed(
        c, "--scale", [a](const std::string& text) { a->scale = parse_number("--scale", text); },
        "of the graph: z = S times the value [1]", "S")
        ->needs(graph);
    iso->excludes(graph);
    add_distance_options(
        c, a->distance,
        {"--error", "--error-relative", "--guarantee", "--stop", "--focus", "--camera", "--graph"});
    add_parsed(
        c, "--bound", [a](const std::string& text) { a->bound = parse_field("--bound", text); },
        "the field by which elements without surface are left out\n"
        "[the tightest that the store has]",
        "FIELD")
        ->excludes(graph);
    CLI::Option* const view = add_parsed(
        c, "--view",
        [a](const std::string& text) { culling_of(*a).direction = parse_double3("--view", text); },
        "leave out what faces away from a viewer who looks in this\n"
        "direction; needs normal_turn_plus or grad_linf_plus",
        "X,Y,Z");
    view->excludes(graph);
    add_parsed(
        c, "--cull-by",
        [a](const std::string& text) { culling_of(*a).field = parse_field("--cull-by", text); },
        "which of the two [normal_turn_plus if there]", "FIELD")
        ->needs(view);
    add_parsed(
        c, "--vertices", [a](const std::string& text) { a->vertices = parse_vertices(text); },
        "where the surface crosses an edge: linear between its ends,\n"
        "or exact, where the data have the isovalue at full resolution;\n"
        "the bound is then twice the error [linear]",
        "linear|exact")
        ->excludes(graph);
    add_cells_option(c, a->extract);
    add_label_options(c, a->labels,
                      {"--iso", "--error", "--error-relative", "--stop", "--focus", "--camera",
                       "--graph", "--view", "--vertices", "--keep-analysis", "--volume-interval"});
    c->add_flag("--normals", a->extract.normals, "vertex normals from the data's gradient");
    c->add_option("--vertex-values", a->values,
                  "vertex values from this other store of the same lattice")
        ->type_name("STORE");
    add_parsed(
        c, "--vertex-error",
        [a](const std::string& text) {
            a->extract.vertex_error = parse_field("--vertex-error", text);
        },
        "this field at the vertices: how far they may be off", "FIELD");
    c->add_flag("--quality", a->extract.options.quality,
                "say which angles the triangles have, from their smallest one on");
    c->add_option("-o,--output", a->extract.mesh, "the mesh to write")
        ->required()
        ->type_name("MESH");
    c->callback([a, iso, &chosen] {
        chosen.run = [a, has_iso = iso->count() > 0](Progress& progress) {
            return run(*a, has_iso, progress);
        };
        chosen.stages = stages_of(*a);
    });
}

}  // namespace isonest::detail::cli
