// isonest extract: from a store or a volume to an isosurface mesh.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <memory>
#include <span>
#include <system_error>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/joined_isovalues.h>
#include <isonest/mesh_file.h>

#include "query/extract/extract_on_ranks.h"
#include "store/ranks/same_folder.h"
#include "store/remote/open_location.h"
#include "tools/cli/command.h"
#include "tools/cli/commands/extract_command.h"
#include "tools/cli/commands/same_store.h"
#include "tools/cli/commands/volume_values.h"
#include "tools/cli/options/close_option.h"
#include "tools/cli/options/component_options.h"
#include "tools/cli/options/fields.h"
#include "tools/cli/options/label_names.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/source_options.h"
#include "tools/cli/options/units.h"

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

ExtractReport run_query(const Store& store, const ExtractCommand& arguments, const Store* values,
                        Progress& progress) {
    const ExtractArguments& a = arguments.extract;
    const std::unique_ptr<MeshSink> sink = open_mesh_file(
        a.mesh, arguments.labels.one ? label_file_options(store, *arguments.labels.one, a.space)
                                     : a.file_options());
    if (a.is_graph) {
        return extract(store, graph_query(arguments, values), *sink, options_of(a), progress);
    }
    const SurfaceQuery query = arguments.surface_query(values);
    return arguments.labels.one
               ? extract(store, arguments.label_query(query, {*arguments.labels.one}), *sink,
                         options_of(a), progress)
               : extract(store, query, *sink, options_of(a), progress);
}

/// A mesh for each isovalue, or one with all of them.
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
    const auto done = [&](std::size_t i, const ExtractReport& r) {
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
    if (in_one) {
        require_place_for_isovalue(mesh);
        const std::unique_ptr<MeshSink> sink =
            open_mesh_file(mesh, arguments.extract.file_options());
        extract_joined(store, isovalues.all, query, *sink, done, options, progress);
    } else {
        extract_isovalues(
            store, isovalues.all, query,
            [&](std::size_t i) {
                return open_mesh_file(each[i].extract.mesh, each[i].extract.file_options());
            },
            done, options, progress);
    }
    return all;
}

/// The input, or nothing if it is no store.
std::optional<Store> open_input_store(ExtractCommand& a, Progress& progress) {
    std::error_code ignored;
    if (a.input.size() > 1 || a.extract.store == "-" ||
        std::filesystem::is_directory(a.extract.store, ignored)) {
        return std::nullopt;
    }
    std::optional<Store> store;
    const std::uint64_t memory = a.extract.options.memory;
    try {
        store.emplace(open_store(a.extract.store, a.remote, a.extract.options.memory, progress));
    } catch (const Error& error) {
        if (!is_no_store(error) && !may_be_folder(error, a.extract.store)) {
            throw;
        }
        a.extract.options.memory = memory;
        a.remote.opened = 0;
        return std::nullopt;
    }
    a.extract.store = store->path().string();
    require_no_source_option(a.source_option, a.extract.store);
    return store;
}

Result extract_store(const Store& store, ExtractCommand arguments, const Store* values,
                     bool has_iso, Progress& progress) {
    const ExtractArguments& a = arguments.extract;
    resolve_label_names(arguments.labels, store);
    arguments.distance.resolve(store.unit(), a.store);
    const LabelArguments& labels = arguments.labels;
    if (labels.keep_nodes && (!labels.smooth || !arguments.distance.stop())) {
        throw Error(ErrorKind::invalid_argument,
                    "--keep-nodes goes with --smooth and with --distance or --triangles: labels "
                    "that are not simplified keep all nodes on their sides");
    }
    const Int3 nodes = store.nodes();
    if (a.options.quality && !a.is_graph && std::min({nodes.x, nodes.y, nodes.z}) == 1) {
        throw Error(ErrorKind::invalid_argument, {a.store},
                    "--quality: isolines are lines, and have no triangles with angles");
    }
    if (labels.interfaces) {
        return extract_label_interfaces(
            store, labels, a, arguments.label_query(arguments.surface_query(values), {}), progress);
    }
    if (labels.several) {
        return extract_label_meshes(
            store, labels, a, arguments.label_query(arguments.surface_query(values), {}), progress);
    }
    if (labels.smooth && !labels.one) {
        throw Error(
            ErrorKind::invalid_argument,
            "--smooth goes with --label or --labels: surfaces of labels are smoothed, those "
            "of isovalues are smooth where the data are; isonest smooth smooths the data");
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
    return result_of({&store, nullptr, store.unit(), store.frame(), {}}, own,
                     run_query(store, own, values, progress));
}

/// By all ranks together: rank 0 has the result.
Result extract_store_on_ranks(Communicator& ranks, const Store& store,
                              const ExtractCommand& arguments, const Store* values, bool has_iso,
                              Progress& progress) {
    // {iso} may be in the folder's name.
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
        result.text += "Rank 0 has done this alone: what was asked for is not shared by ranks.\n";
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

Result run(ExtractCommand& arguments, bool has_iso, Communicator* ranks, Progress& progress) {
    arguments.extract.store = arguments.input.front();
    require_suitable_cells(arguments.extract);
    const std::optional<Store> store = open_input_store(arguments, progress);
    if (ranks != nullptr) {
        require_same_store(*ranks, store ? &store->reader() : nullptr,
                           shown_location(arguments.extract.store));
    }
    if (!store) {
        // A volume is read once, by one process.
        return ranks == nullptr || ranks->rank() == 0
                   ? extract_volume_file(arguments, has_iso, progress)
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
    if (others && others->is_remote()) {
        result.json["remote_values"] = fetched_json(others->fetched());
        result.text += "vertex values: " + fetched_text(others->fetched());
    }
    return result;
}

/// Options that have an effect on what is extracted from a store alone.
constexpr std::array kOfStores{"--error",
                               "--error-relative",
                               "--guarantee",
                               "--stop",
                               "--threshold",
                               "--focus",
                               "--falloff",
                               "--threshold-relative",
                               "--camera",
                               "--pixels",
                               "--fov",
                               "--height",
                               "--box",
                               "--graph",
                               "--scale",
                               "--close",
                               "--bound",
                               "--volume-interval",
                               "--by",
                               "--simplify",
                               "--view",
                               "--no-simplify",
                               "--keep-analysis",
                               "--cull-by",
                               "--vertices",
                               "--cells",
                               "--label",
                               "--labels",
                               "--smooth",
                               "--keep-nodes",
                               "--interfaces",
                               "--format",
                               "--vertex-values",
                               "--vertex-error"};

/// Those of these options that were given.
std::vector<std::string> given_of(const CLI::App& command, std::span<const char* const> options) {
    std::vector<std::string> given;
    for (const char* const option : options) {
        if (command.get_option(option)->count() > 0) {
            given.emplace_back(option);
        }
    }
    return given;
}

/// What usually comes, and how long it takes beside the rest.
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
        return stages;
    }
    if (a.labels.smooth) {
        stages.push_back({"find labels", "finding the label", 0.2});
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
    const auto a = std::make_shared<ExtractCommand>();
    CLI::App* const c = add_command(
        app, chosen, "extract",
        {"Write an isosurface of a store as a mesh, with a guaranteed error",
         "INPUT is a store, or any volume that preprocess reads (a file, a folder or files of "
         "slices, -).\n"
         "A volume is read once and needs no store, for the surface of one isovalue by hexahedra "
         "at\n"
         "full resolution, simplified within a --distance or to --triangles; --crop takes a part "
         "of it.\n"
         "For errors, --box, --close, labels, several isovalues: isonest preprocess first.\n"
         "The mesh is crack-free, and nowhere further from the isovalue than the error says. A "
         "larger\n"
         "error gives fewer triangles and reads less; error 0 gives the surface at full "
         "resolution.\n"
         "The name of the mesh chooses its format: .ply .stl .obj .vtp .vtkhdf .glb .3mf. Data "
         "in a plane\n"
         "(one node along an axis) give isolines (.vtp .obj), or their graph.",
         "isonest extract scan.isonest --iso 120 -o full.ply\n"
         "isonest extract scan.nrrd --iso 120 -o full.ply\n"
         "isonest extract https://example.org/scan.isonest --iso 120 --error-relative 0.01 -o "
         "coarse.ply\n"
         "isonest extract scan.isonest --iso 120 --error-relative 0.01 -o coarse.glb --normals\n"
         "isonest extract scan.isonest --iso 80,120,160 -o surface_{iso}.ply\n"
         "isonest extract scan.isonest --iso 80,120,160 -o surfaces.vtp\n"
         "isonest extract scan.isonest --iso 120 --distance 0.5voxel -o small.stl\n"
         "isonest extract scan.isonest --iso 120 --error-relative 0.01 --simplify -o light.glb\n"
         "isonest extract scan.isonest --iso 120 --triangles 100000 -o web.glb\n"
         "isonest extract scan.isonest --iso 120.5 --close --components largest -o print.3mf\n"
         "isonest extract cells.isonest --labels all --distance 0.5voxel -o meshes\n"
         "isonest extract cells.isonest --labels all --smooth -o meshes\n"
         "isonest extract cells.isonest --labels all --smooth --interfaces -o interfaces.vtp\n"
         "isonest extract cells.isonest --labels all --smooth --format neuroglancer-multilod -o "
         "meshes\n"
         "isonest extract organs.isonest --label liver --smooth -o liver.glb\n"
         "isonest extract scan.isonest --iso 120 --error 2 --box 0,0,0,50,50,20 -o corner.ply\n"
         "isonest extract scan.isonest --iso 120 --error 1 --focus 30,40,20 --falloff 0.1 -o "
         "near.ply\n"
         "isonest extract scan.isonest --iso 120 --stop normal_bar --threshold 0.2 -o smooth.vtp\n"
         "isonest extract map.isonest --iso 500 --error 2 -o contour.vtp\n"
         "isonest extract map.isonest --graph --scale 3 --error 5 -o relief.glb --normals"});
    c->add_option("INPUT", a->input,
                  "a store that isonest preprocess made, a file or a URL; or a volume file")
        ->required();
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
    add_label_options(
        c, a->labels,
        {"--iso", "--error", "--error-relative", "--stop", "--focus", "--camera", "--graph",
         "--bound", "--view", "--vertices", "--keep-analysis", "--volume-interval"});
    add_space_option(c, a->extract);
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
    add_remote_options(c, a->remote);
    add_source_options(c, a->source, false);
    c->callback([a, c, iso, &chosen] {
        a->source_option = given_source_option(*c);
        a->store_options = given_of(*c, kOfStores);
        chosen.run = [a, ranks = chosen.ranks, has_iso = iso->count() > 0](Progress& progress) {
            std::vector<std::string> inputs = a->input;
            inputs.push_back(a->values);
            require_far(a->remote, inputs);
            return run_beside_fetching(a->remote,
                                       [&] { return run(*a, has_iso, ranks, progress); });
        };
        chosen.stages = stages_of(*a);
    });
}

}  // namespace isonest::detail::cli
