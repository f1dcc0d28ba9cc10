// isonest extract: extracts an isosurface mesh from a store or a volume.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/joined_isovalues.h>
#include <isonest/mesh_file.h>

#include "query/extract/combinations.h"
#include "query/extract/extract_shared.h"
#include "store/files/output_file.h"
#include "store/lattice/lattice.h"
#include "store/ranks/agreement.h"
#include "store/remote/open_location.h"
#include "tools/cli/commands/extract_command.h"
#include "tools/cli/commands/input_store.h"
#include "tools/cli/commands/series_command.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/options/label_names.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/surface_options.h"
#include "tools/cli/options/tile_output.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {
namespace {

/// REQUIRES: the option needs --view.
BackfaceCulling& culling_of(ExtractCommand& a) {
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

GraphQuery graph_query(const ExtractCommand& arguments, const Store* values) {
    auto query = arguments.begun<GraphQuery>(values);
    query.scale = arguments.scale;
    query.cells = arguments.extract.cells.value_or(Cells::tetrahedra);
    return query;
}

/// The attribute by which --colors colours the vertices. Throws Error{invalid_argument} if it is
/// the same at all vertices.
std::string attribute_to_color(const ExtractCommand& arguments) {
    const ExtractArguments& a = arguments.extract;
    const LabelArguments& labels = arguments.labels;
    const auto scalar =
        std::find_if(arguments.named_values.begin(), arguments.named_values.end(),
                     [](const NamedValues& values) { return values.sources.size() == 1; });
    const bool has_values = !arguments.values.empty() || a.is_graph;
    if (!has_values && scalar != arguments.named_values.end()) {
        return scalar->name;
    }
    if (labels.one || labels.several) {
        throw Error(ErrorKind::invalid_argument,
                    "--colors is for surfaces of values: each label has one colour, which the "
                    "option --label-names of isonest preprocess sets; to colour by another "
                    "quantity, add --vertex-values NAME=STORE");
    }
    if (has_values) {
        return "value";
    }
    if (arguments.isovalues.all.size() > 1 && !is_own_name(a.mesh)) {
        return "isovalue";
    }
    if (!a.vertex_error) {
        throw Error(ErrorKind::invalid_argument,
                    "--colors: on a surface of one isovalue all vertices have the same value; add "
                    "--vertex-values STORE, --vertex-error FIELD or more isovalues");
    }
    if (!a.color_range) {
        throw Error(ErrorKind::invalid_argument,
                    "--colors with --vertex-error needs --range LOW,HIGH");
    }
    return "error";
}

void choose_vertex_colors(ExtractCommand& arguments, const Store& store, const Store* values) {
    ExtractArguments& a = arguments.extract;
    if (a.color_map.empty()) {
        return;
    }
    const std::string attribute = attribute_to_color(arguments);
    if (attribute == "isovalue") {
        const auto [low, high] =
            std::minmax_element(arguments.isovalues.all.begin(), arguments.isovalues.all.end());
        choose_colors(a, attribute, *low, *high);
    } else if (a.field_to_color && attribute == a.field_to_color->name) {
        choose_colors(a, attribute, a.field_to_color->low, a.field_to_color->high);
    } else {
        const Store& of = values != nullptr ? *values : store;
        choose_colors(a, attribute, of.min_value(), of.max_value());
    }
}

Result run_query(const Store& store, const ExtractCommand& arguments, const Store* values,
                 Progress& progress) {
    const ExtractArguments& a = arguments.extract;
    const MeshFileOptions file =
        arguments.labels.one ? label_file_options(store, *arguments.labels.one, a.file_options())
                             : a.file_options();
    std::optional<std::array<double, 2>> heights;
    if (a.is_graph) {
        const std::array ends{arguments.scale * store.min_value(),
                              arguments.scale * store.max_value()};
        heights = {std::min(ends[0], ends[1]), std::max(ends[0], ends[1])};
    }
    MeshOutput output(a, file, store.reader().layout().header(), {}, heights);
    ExtractReport report;
    {
        const std::unique_ptr<MeshSink> sink = output.sink();
        const ExtractOptions options = options_of(a);
        if (a.is_graph) {
            report = extract(store, graph_query(arguments, values), *sink, options, progress);
        } else {
            const SurfaceQuery query = arguments.surface_query(values);
            report = arguments.labels.one
                         ? extract(store, arguments.label_query(query, {*arguments.labels.one}),
                                   *sink, options, progress)
                         : extract(store, query, *sink, options, progress);
        }
    }
    Result result =
        result_of({&store, nullptr, store.unit(), store.frame(), {}}, arguments, report);
    output.finish(report, progress, result);
    return result;
}

/// The features of a tileset of several isovalues.
std::vector<TileFeature> isovalue_features(const ExtractCommand& arguments) {
    std::vector<TileFeature> features;
    for (const double isovalue : arguments.isovalues.all) {
        features.push_back({{}, isovalue, {}, {}});
    }
    return features;
}

/// Writes one mesh per isovalue, or one mesh with all isovalues.
Result run_isovalues(const Store& store, const ExtractCommand& arguments, const Store* values,
                     Progress& progress) {
    const Isovalues& isovalues = arguments.isovalues;
    const std::string& mesh = arguments.extract.mesh;
    const bool in_one = !is_own_name(mesh);
    std::vector<ExtractCommand> each(isovalues.all.size(), arguments);
    for (std::size_t i = 0; i < each.size(); ++i) {
        each[i].extract.mesh = mesh_name(mesh, isovalues.texts[i]);
        each[i].isovalues = {{isovalues.all[i]}, {isovalues.texts[i]}};
    }
    Result all;
    all.json = {{"meshes", Json::array()}};
    std::vector<ExtractReport> reports(each.size());
    ExtractReport furthest;  // with the largest distance, if they are simplified
    const auto done = [&](std::size_t i, const ExtractReport& r) {
        reports[i] = r;
        if (i == 0 || (r.distance && r.distance->bound > furthest.distance->bound)) {
            furthest = r;
        }
        Result result = result_of({&store, nullptr, store.unit(), store.frame(), {}}, each[i], r);
        all.json["meshes"].push_back(std::move(result.json));
        all.text += in_one ? fmt::format("isovalue {} in ", isovalues.texts[i]) : "";
        all.text += result.text;
        if (!result.warning.empty()) {
            all.warning += (all.warning.empty() ? "" : "\n") + result.warning;
        }
    };
    const SurfaceQuery query = arguments.surface_query(values);
    const ExtractOptions options = options_of(arguments.extract);
    const auto output_of = [&](const ExtractArguments& a, std::vector<TileFeature> features) {
        return MeshOutput(a, a.file_options(), store.reader().layout().header(),
                          std::move(features));
    };
    const bool tiles = makes_tiles(arguments.extract);
    // A file of several objects, unless the format holds the isovalues of one mesh.
    const bool objects = in_one && !tiles && makes_objects(mesh, std::string()) &&
                         lower_extension(mesh) != ".vtkhdf";
    if (in_one && !objects) {
        if (!tiles) {
            require_place_for_isovalue(mesh);
        }
        MeshOutput output = output_of(
            arguments.extract, tiles ? isovalue_features(arguments) : std::vector<TileFeature>{});
        const std::unique_ptr<MeshSink> sink = output.sink();
        extract_joined(store, isovalues.all, query, *sink, done, options, progress);
        output.finish(furthest, progress, all);
        return all;
    }
    std::vector<MeshOutput> outputs;
    if (objects) {
        outputs.push_back(output_of(arguments.extract, isovalue_features(arguments)));
    } else {
        for (const ExtractCommand& own : each) {
            outputs.push_back(output_of(own.extract, {}));
        }
    }
    extract_isovalues(
        store, isovalues.all, query,
        [&](std::size_t i) { return objects ? outputs.front().sink(i) : outputs[i].sink(); }, done,
        options, progress);
    for (std::size_t i = 0; i < outputs.size(); ++i) {
        outputs[i].finish(reports[i], progress, all);
    }
    return all;
}

Result extract_store(const Store& store, ExtractCommand arguments, const Store* values,
                     bool has_iso, Progress& progress) {
    const ExtractArguments& a = arguments.extract;
    resolve_label_names(arguments.labels, store);
    choose_vertex_colors(arguments, store, values);
    arguments.distance.resolve(store.unit(), a.store);
    const LabelArguments& labels = arguments.labels;
    if (labels.keep_nodes && (!labels.smooth || !arguments.distance.stop())) {
        throw Error(ErrorKind::invalid_argument,
                    "--keep-nodes needs --smooth with --distance or --triangles: without "
                    "simplification, every node stays on its side anyway");
    }
    const Int3 nodes = store.nodes();
    if (a.options.quality && !a.is_graph && std::min({nodes.x, nodes.y, nodes.z}) == 1) {
        throw Error(ErrorKind::invalid_argument, {a.store},
                    "--quality: isolines have no triangles");
    }
    if (labels.interfaces) {
        return extract_label_interfaces(
            store, labels, a, arguments.label_query(arguments.surface_query(values), {}), progress);
    }
    if (labels.several) {
        const LabelQuery query = arguments.label_query(arguments.surface_query(values), {});
        const bool together =
            makes_tiles(a) || makes_objects(a.mesh, labels.has_format ? labels.format : "");
        return together ? extract_labels_together(store, labels, a, query, progress)
                        : extract_label_meshes(store, labels, a, query, progress);
    }
    if (labels.smooth && !labels.one) {
        throw Error(ErrorKind::invalid_argument,
                    "--smooth needs --label or --labels; to smooth the data of an isosurface use "
                    "isonest smooth");
    }
    if (!has_iso && !a.is_graph && !labels.one) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("give the isovalue, --iso V, or a --label; the values of {} are {}",
                                a.store, range_text(store)));
    }
    if (arguments.isovalues.all.size() > 1) {
        return run_isovalues(store, arguments, values, progress);
    }
    ExtractCommand own = arguments;
    if (has_iso) {
        own.extract.mesh = mesh_name(a.mesh, arguments.isovalues.texts.front());
    }
    return run_query(store, own, values, progress);
}

/// Collective; only rank 0 returns the result.
Result extract_store_on_ranks(Communicator& ranks, const Store& store,
                              const ExtractCommand& arguments, const Store* values, bool has_iso,
                              Progress& progress) {
    // The name of the folder may contain {iso}.
    const std::vector<std::string>& texts = arguments.isovalues.texts;
    const std::string& mesh = arguments.extract.mesh;
    require_same_folder(ranks, texts.empty() ? mesh : mesh_name(mesh, texts.front()));
    Result result;
    const RankWork work = extract_on_ranks(
        ranks, store, values,
        [&](const ExtractOptions& options) {
            ExtractCommand own = arguments;
            own.extract.options.team = options.team;
            result = extract_store(store, own, values, has_iso, progress);
        },
        options_of(arguments.extract), progress);
    if (ranks.rank() == 0 && ranks.size() > 1 && work.traversals + work.mappings == 0) {
        result.text += "Rank 0 did this alone: this query is not distributed.\n";
    }
    result.rank = {{"traversals", work.traversals},
                   {"traversal_seconds", work.traversal_seconds},
                   {"gathering_seconds", work.gathering_seconds},
                   {"leaves", work.leaves},
                   {"chunks_read", work.chunks_read},
                   {"bytes_read", work.bytes_read},
                   {"parts_bytes", work.parts_bytes},
                   {"mappings", work.mappings},
                   {"mapped_blocks", work.mapped_blocks},
                   {"mapped_triangles", work.mapped_triangles},
                   {"mapping_seconds", work.mapping_seconds},
                   {"meshes", work.meshes},
                   {"written_triangles", work.written_triangles},
                   {"welding_seconds", work.welding_seconds},
                   {"writing_seconds", work.writing_seconds}};
    return result;
}

void add_fetched_values(const Store& values, Result& result) {
    if (values.is_remote()) {
        result.json["remote_values"] = fetched_json(values.fetched());
        result.text += "vertex values: " + fetched_text(values.fetched());
    }
}

/// Extracts directly from the volume if possible, otherwise from a store made from it.
Result extract_volume(ExtractCommand& arguments, bool has_iso, Progress& progress) {
    ExtractArguments& a = arguments.extract;
    InputArguments& in = arguments.in;
    a.store = in.shown();
    const std::optional<Store> others = open_values(arguments, progress);
    in.source.labels = arguments.labels.one || arguments.labels.several;
    const std::filesystem::path scratch = options_of(a).scratch;
    std::unique_ptr<VolumeSource> volume =
        open_input_volume(in, a.options.memory, scratch, progress);
    if (needs_no_store(*volume, arguments, has_iso)) {
        return extract_from_volume(*volume, arguments, progress);
    }
    arguments.distance.resolve(volume->describe().unit, a.store);
    if (has_iso && !a.is_graph && !arguments.labels.one && !arguments.labels.several) {
        // Checked now, before time is spent on making a store.
        const VolumeDescription d = volume->describe();
        require_combination(features_of(arguments.surface_query(nullptr),
                                        {Lattice(d.nodes).dimension(), is_uneven(d)}),
                            a.store);
    }
    if (!has_iso && !a.is_graph && !arguments.labels.one && !arguments.labels.several) {
        throw Error(ErrorKind::invalid_argument, {a.store},
                    "give the isovalue, --iso V, or a --label; isonest info --histogram shows the "
                    "values");
    }
    if (arguments.distance.analysis && arguments.distance.analysis->folder.empty() &&
        in.keep.empty()) {
        throw Error(ErrorKind::invalid_argument, {a.store},
                    "--keep-analysis keeps the analysis next to the store: add --keep-store STORE, "
                    "and give STORE as INPUT the next time");
    }
    if (!arguments.labels.several && !makes_tiles(a)) {
        check_output(a.mesh, true, volume->files());
    }
    const std::vector<Field> fields = a.is_graph ? fields_needed(graph_query(arguments, nullptr))
                                                 : fields_needed(arguments.surface_query(nullptr));
    const MadeStore made = make_store_of(
        *volume, a.store, {in.keep, a.mesh, fields, a.options.memory, a.options.threads}, progress);
    volume.reset();
    Result result = run_on(made, [&] {
        return extract_store(made.store, arguments, others ? &*others : nullptr, has_iso, progress);
    });
    made.report(result);
    if (others) {
        add_fetched_values(*others, result);
    }
    return result;
}

/// Throws Error{invalid_argument} for options that need another format.
void choose_format(ExtractCommand& arguments) {
    ExtractArguments& a = arguments.extract;
    a.tiles = arguments.labels.format == kTiles;
    if (arguments.labels.has_format && !arguments.labels.several && !a.tiles) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("--format {} needs --labels; otherwise the extension of MESH "
                                "selects the format",
                                arguments.labels.format));
    }
    if (a.georeference && !a.tiles) {
        throw Error(ErrorKind::invalid_argument, "--georeference needs --format 3dtiles");
    }
    if (!a.tiles) {
        return;
    }
    if (a.up != UpAxis::z) {
        throw Error(ErrorKind::invalid_argument,
                    "--up y: in 3D Tiles, z always points up, and viewers know it");
    }
    if (arguments.labels.over) {
        throw Error(ErrorKind::invalid_argument,
                    "--over needs --format neuroglancer or neuroglancer-multilod");
    }
    a.mesh = folder_name(a.mesh);
    a.normals = a.normals || (!arguments.labels.one && !arguments.labels.several);
}

/// Extracts from the store or the volume that INPUT names.
Result extract_input(ExtractCommand& arguments, bool has_iso, Communicator* ranks,
                     Progress& progress) {
    const std::optional<Store> store =
        open_if_store(arguments.in, arguments.extract.options.memory, progress);
    arguments.extract.store = store ? store->path().string() : arguments.in.shown();
    if (ranks != nullptr) {
        require_same_store(*ranks, store ? &store->reader() : nullptr, arguments.extract.store);
    }
    if (!store) {
        // A volume is read once, by one process.
        return ranks == nullptr || ranks->rank() == 0 ? extract_volume(arguments, has_iso, progress)
                                                      : Result{};
    }
    const std::optional<Store> others = open_values(arguments, progress);
    const Store* const values = others ? &*others : nullptr;
    if (ranks != nullptr) {
        require_same_store(
            *ranks, values != nullptr ? &values->reader() : nullptr,
            values != nullptr ? shown_location(arguments.values) : "--vertex-values");
    }
    Result result = ranks == nullptr ? extract_store(*store, arguments, values, has_iso, progress)
                                     : extract_store_on_ranks(*ranks, *store, arguments, values,
                                                              has_iso, progress);
    add_fetched(*store, result);
    if (others) {
        add_fetched_values(*others, result);
    }
    return result;
}

/// Sets the store of values and the named values from those of --vertex-values.
void take_vertex_values(ExtractCommand& arguments, const std::vector<std::string>& texts) {
    for (const std::string& text : texts) {
        if (std::optional<NamedValues> named = parse_named_values(text)) {
            arguments.named_values.push_back(std::move(*named));
        } else if (arguments.values.empty()) {
            arguments.values = text;
        } else {
            throw Error(
                ErrorKind::invalid_argument,
                "--vertex-values: only one STORE can be given without a name; give the others "
                "as NAME=STORE");
        }
    }
    if (arguments.extract.is_graph && !arguments.named_values.empty()) {
        throw Error(ErrorKind::invalid_argument,
                    "--vertex-values NAME=STORE: not for graphs, because their heights are not "
                    "positions in a volume; give a STORE of the same lattice, without a name");
    }
}

Result run(ExtractCommand& arguments, bool has_iso, Communicator* ranks, Progress& progress) {
    if (const std::optional<Series> series = open_if_series(arguments.in, ranks)) {
        return write_steps(
            *series, std::exchange(arguments.times, ""), arguments.extract.mesh,
            arguments.isovalues.texts, progress,
            [&](const std::string& store, const std::string& mesh, Progress& step_progress) {
                ExtractCommand own = arguments;
                own.in.input = {store};
                own.extract.mesh = mesh;
                return run(own, has_iso, ranks, step_progress);
            });
    }
    require_no_times(arguments.times, arguments.in.shown());
    require_suitable_cells(arguments.extract);
    choose_format(arguments);
    if (!arguments.extract.color_map.empty()) {
        attribute_to_color(arguments);
    }
    const VertexValues named(arguments.named_values, arguments.extract, arguments.in.remote, ranks,
                             progress);
    Result result = named.run([&] { return extract_input(arguments, has_iso, ranks, progress); });
    if (ranks == nullptr || ranks->rank() == 0) {
        named.report(result);
    }
    return result;
}

/// The stages of a typical run, with their relative durations.
std::vector<ProgressStage> stages_of(const ExtractCommand& a) {
    std::vector<ProgressStage> stages;
    if (a.labels.several) {
        stages = {{"find labels", "finding the labels", 0.2}, {"extract", "extracting", 1}};
        if (a.labels.smooth) {
            if (a.distance.distance || a.distance.triangles > 0 || makes_detail_levels(a.labels)) {
                stages.push_back({"simplify", "simplifying", 3});
            }
            stages.push_back({"write mesh", "writing the meshes", 0.5});
        }
        if (a.labels.format == kTiles) {
            stages.push_back({"write tiles", "writing tiles", 0.5});
            stages.push_back({"simplify tiles", "simplifying tiles", 4});
        }
        return stages;
    }
    if (a.labels.smooth) {
        stages.push_back({"find labels", "finding the label", 0.2});
    }
    stages.push_back(
        {"extract", a.extract.is_graph ? "making the graph" : "extracting the surface", 0.6});
    if (a.components) {
        stages.push_back({"find components", "finding components", 0.3});
        stages.push_back({"drop components", "dropping small components", 0.1});
    }
    if (a.is_simplified()) {
        stages.push_back({"simplify", "simplifying", 5});
    }
    if (a.labels.format == kTiles) {
        stages.push_back({"write tiles", "writing tiles", 0.5});
        stages.push_back({"simplify tiles", "simplifying tiles", 4});
        return stages;
    }
    stages.push_back({"write mesh", "writing the mesh", 0.4});
    return stages;
}

}  // namespace

void add_extract(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<ExtractCommand>();
    CLI::App* const c = add_command(
        app, chosen, "extract",
        {"Write an isosurface as a mesh, with a guaranteed error",
         "INPUT is a store or a volume. If an option needs a store, a temporary one is "
         "made from the volume; --keep-store keeps it. The mesh has no cracks, and its "
         "error is at most the one requested: a larger error gives fewer triangles and "
         "reads less data, error 0 gives the full-resolution surface. The extension of "
         "MESH selects the format. Several isovalues go into one file (.ply .vtp "
         ".vtkhdf .glb .3mf), or, with {iso} in the name, into one file each. For a series, {time} "
         "or {step} in the name makes a file for each step. Data in "
         "a plane give isolines (.vtp .obj) or their graph.",
         "isonest extract scan.isonest --iso 120 -o full.ply\n"
         "isonest extract scan.isonest --iso 120 --error 2% -o coarse.glb --normals\n"
         "isonest extract scan.nii.gz --iso 300 --distance 0.5mm --close -o bone.stl\n"
         "isonest extract scan.isonest --iso 120 --triangles 100000 -o web.glb\n"
         "isonest extract scan.isonest --iso 80,120,160 -o surface_{iso}.ply\n"
         "isonest extract scan.isonest --iso 120 --box 0,0,0,50,50,20 -o corner.ply\n"
         "isonest extract https://example.org/scan.isonest --iso 120 -o full.ply\n"
         "isonest extract run.isonest --iso 120 -o run_{time}.vtp\n"
         "isonest extract organs.isonest --label liver --smooth -o liver.glb\n"
         "isonest extract cells.isonest --labels all --smooth -o meshes\n"
         "isonest extract heart.isonest --iso 80 --vertex-values p=pressure.isonest -o p.vtp\n"
         "isonest extract scan.isonest --iso 120 --format 3dtiles -o site\n"
         "isonest extract map.isonest --graph --scale 3 --error 5 -o relief.glb"});
    add_input_options(c, a->in, false);
    add_extract_options(c, a->extract);
    CLI::Option* const iso = add_isovalue_option(c, a->isovalues);
    CLI::Option* const graph = c->add_flag("--graph", a->extract.is_graph);
    for (CLI::Option* const option : add_component_options(c, a->components)) {
        option->excludes(graph);
    }
    CLI::Option* const close = add_close_option(c, a->close);
    close->excludes(graph);
    c->add_flag("--volume-interval", a->volume_interval)->needs(close);
    c->add_flag("--manifold", a->manifold)->excludes(graph);
    add_parsed(c, "--scale", [a](const std::string& text) {
        a->scale = parse_number("--scale", text);
    })->needs(graph);
    iso->excludes(graph);
    add_distance_options(
        c, a->distance,
        {"--error", "--error-relative", "--indicator", "--stop", "--focus", "--camera", "--graph"});
    add_parsed(c, "--bound", [a](const std::string& text) {
        a->bound = parse_field("--bound", text);
    })->excludes(graph);
    CLI::Option* const view = add_parsed(c, "--view", [a](const std::string& text) {
        culling_of(*a).direction = parse_double3("--view", text);
    });
    view->excludes(graph);
    add_parsed(c, "--cull-by", [a](const std::string& text) {
        culling_of(*a).field = parse_field("--cull-by", text);
    })->needs(view);
    add_parsed(c, "--vertices", [a](const std::string& text) {
        a->vertices = parse_vertices(text);
    })->excludes(graph);
    add_cells_option(c, a->extract);
    add_label_options(
        c, a->labels,
        {"--iso", "--error", "--error-relative", "--stop", "--focus", "--camera", "--graph",
         "--bound", "--view", "--vertices", "--keep-analysis", "--volume-interval"});
    add_space_options(c, a->extract);
    add_tile_options(c, a->extract);
    c->add_option("--colors", a->extract.color_map);
    add_parsed(c, "--range", [a](const std::string& text) {
        a->extract.color_range = parse_range(text);
    })->needs("--colors");
    c->add_flag("--normals", a->extract.normals);
    const auto values = std::make_shared<std::vector<std::string>>();
    c->add_option("--vertex-values", *values)->allow_extra_args(false);
    add_parsed(c, "--vertex-error", [a](const std::string& text) {
        a->extract.vertex_error = parse_field("--vertex-error", text);
    });
    c->add_flag("--quality", a->extract.options.quality);
    c->add_option("--times", a->times);
    c->add_option("-o,--output", a->extract.mesh)->required();
    c->callback([a, c, iso, values, &chosen] {
        note_source_option(*c, a->in);
        take_vertex_values(*a, *values);
        chosen.run = [a, ranks = chosen.ranks, has_iso = iso->count() > 0](Progress& progress) {
            std::vector<std::string> inputs = a->in.input;
            inputs.push_back(a->values);
            for (const NamedValues& named : a->named_values) {
                inputs.insert(inputs.end(), named.sources.begin(), named.sources.end());
            }
            return run_beside_fetching(a->in.remote, inputs,
                                       [&] { return run(*a, has_iso, ranks, progress); });
        };
        if (!is_series(a->in.input.front())) {
            chosen.stages = with_store_stages(stages_of(*a));
        }
    });
}

}  // namespace isonest::detail::cli
