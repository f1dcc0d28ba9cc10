// isonest slice: a plane through the data, as a coloured mesh or as a picture.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <memory>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/mesh_file.h>

#include "query/extract/own_axes.h"
#include "store/container/extent.h"
#include "store/container/reader.h"
#include "tools/cli/command.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/options/fields.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/units.h"
#include "tools/drawing/png_writer.h"
#include "tools/drawing/slice_picture.h"

namespace isonest::detail::cli {
namespace {

struct SliceArguments {
    ExtractArguments extract;
    WorldPlane plane;
    SlicePictureOptions picture;  ///< its contours also if no picture is drawn
    bool has_range = false;
    std::string picture_option;  ///< one that is of pictures, or empty
    RemoteArguments remote;
};

/// Whether the plane has a point of the volume.
bool meets_volume(const Store& store, const WorldPlane& plane) {
    const StoreHeader& h = store.reader().layout().header();
    const WorldPlane own = in_own_axes(plane, h);
    const Double3 last = last_position(h);
    double low = -own.offset;
    double high = low;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double from = own.normal[axis] * h.origin[axis];
        const double to = own.normal[axis] * last[axis];
        low += std::min(from, to);
        high += std::max(from, to);
    }
    return low <= 0 && high >= 0;
}

/// Why there is nothing in it. `is_lines`: of contour lines.
std::string empty_slice(const Store& store, const SliceArguments& a, bool is_lines) {
    const std::optional<WorldBox>& box = a.extract.box;
    if (!meets_volume(store, a.plane)) {
        return fmt::format("The slice is empty: the plane misses the volume, {}.\n",
                           volume_text(store));
    }
    if (box && !reaches_volume(store, *box)) {
        return fmt::format("The slice is empty: the box lies outside of the volume, {}.\n",
                           volume_text(store));
    }
    if (is_lines) {
        return fmt::format(
            "There is no line: the values do not occur in the plane{}. Those of the volume are "
            "{}.\n",
            box ? " inside the box" : "", human_range(store.min_value(), store.max_value()));
    }
    return box ? "The slice is empty: the plane does not pass through the box, or what is there "
                 "is missing.\n"
               : "The slice is empty: the plane touches the volume at most in an edge, or its "
                 "values are missing.\n";
}

ExtractReport run_contours(const Store& store, const SliceArguments& a, Progress& progress) {
    if (a.extract.cells.value_or(Cells::tetrahedra) != Cells::tetrahedra) {
        throw Error(ErrorKind::invalid_argument,
                    "--contours: lines in a mesh are those of tetrahedra, without --cells");
    }
    if (a.extract.normals || a.extract.vertex_error) {
        throw Error(ErrorKind::invalid_argument,
                    "--contours: lines carry their value, no --normals and no --vertex-error");
    }
    auto query = a.extract.query<ContourQuery>();
    query.plane = a.plane;
    query.values = a.picture.contours;
    const auto sink = open_mesh_file(a.extract.mesh, a.extract.file_options());
    return extract(store, query, *sink, options_of(a.extract), progress);
}

ExtractReport run_slice(const Store& store, const SliceArguments& a, MeshSink& sink,
                        Progress& progress) {
    auto query = a.extract.query<SliceQuery>();
    query.plane = a.plane;
    query.cells = a.extract.cells.value_or(Cells::tetrahedra);
    query.attributes = {a.extract.normals, nullptr, a.extract.vertex_error};
    return extract(store, query, sink, options_of(a.extract), progress);
}

Result run(SliceArguments& a, Progress& progress) {
    require_suitable_cells(a.extract);
    const Store store = open_store(a.extract.store, a.remote, a.extract.options.memory, progress);
    if (!a.has_range) {
        a.picture.low = store.min_value();
        a.picture.high = store.max_value();
    }
    const bool picture = is_png(a.extract.mesh);
    const bool lines = !picture && !a.picture.contours.empty();
    if (!picture && a.picture.grid) {
        throw Error(ErrorKind::invalid_argument, {a.extract.mesh},
                    "--grid is drawn into a picture; give a name that ends with .png");
    }
    if (picture && a.extract.space != MeshSpace::automatic) {
        throw Error(ErrorKind::invalid_argument, {a.extract.mesh},
                    "--space is of the positions in a mesh; this is a picture");
    }
    ExtractReport r;
    if (picture && (a.extract.normals || a.extract.vertex_error)) {
        throw Error(ErrorKind::invalid_argument, {a.extract.mesh},
                    fmt::format("{} goes with a mesh: a picture holds nothing of vertices",
                                a.extract.normals ? "--normals" : "--vertex-error"));
    }
    if (!picture && !a.picture_option.empty()) {
        throw Error(ErrorKind::invalid_argument, {a.extract.mesh},
                    a.picture_option + " goes with a picture: an --output that ends with .png");
    }
    if (picture) {
        a.picture.normal = a.plane.normal;
        // While it is drawn, the mesh's parts are within the rest.
        a.picture.memory = a.extract.options.memory / 4;
        SlicePicture sink(a.extract.mesh, a.picture);
        r = run_slice(store, a, sink, progress);
    } else if (lines) {
        r = run_contours(store, a, progress);
    } else {
        const auto sink = open_mesh_file(a.extract.mesh, a.extract.file_options());
        r = run_slice(store, a, *sink, progress);
    }
    Result result;
    result.warning = extract_warning(a.extract, r);
    if (store.reader().label_names().size() > 0) {
        result.warning += result.warning.empty() ? "" : "\n";
        result.warning += fmt::format(
            "{}: its values are labels with names, and a slice is linear between nodes: between "
            "the labels 1 and 3 it shows 2; isonest export writes the labels themselves",
            a.extract.store);
    }
    result.json = extract_json(a.extract, r);
    result.json["unit"] = unit_json(store.unit());
    if (!picture) {
        add_space_json(store.frame(), a.extract, a.extract.mesh, result.json);
    }
    result.text = fmt::format("{}: {} {}, {} vertices, in {}\n{}; read {} of {} chunks, {}\n",
                              a.extract.mesh, r.triangles, lines ? "lines" : "triangles",
                              r.vertices, human_seconds(r.seconds), guarantee_text(a.extract, r),
                              r.traversal.chunks_read, r.traversal.chunks_total,
                              human_bytes(static_cast<double>(r.traversal.bytes_read)));
    if (!picture) {
        result.text += space_line(store.frame(), a.extract, a.extract.mesh);
    }
    if (r.triangles == 0) {
        result.text += empty_slice(store, a, lines);
    }
    add_fetched(store, result);
    return result;
}

WorldPlane parse_plane(const std::string& text) {
    const std::vector<double> v = parse_numbers("--plane", text, 4, "NX,NY,NZ,D");
    return {{v[0], v[1], v[2]}, v[3]};
}

std::vector<double> parse_contours(const std::string& text) {
    const auto count = static_cast<std::size_t>(std::count(text.begin(), text.end(), ',')) + 1;
    return parse_numbers("--contours", text, count, "V,V,...");
}

}  // namespace

void add_slice(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<SliceArguments>();
    CLI::App* const c = add_command(
        app, chosen, "slice",
        {"Write a plane through a store as a coloured mesh or a picture",
         "The plane is made of triangles that are as large as the error allows; the mesh's "
         "vertices\n"
         "have the value. Ending with .png the output is a picture, else a mesh (.ply .vtp "
         ".vtkhdf\n"
         ".glb; .stl, .obj and .3mf hold no values).",
         "isonest slice scan.isonest --plane 0,0,1,35 --error 2 -o slice.png --grid\n"
         "isonest slice scan.isonest --plane 1,1,0,90 --error-relative 0.02 -o oblique.vtp\n"
         "isonest slice scan.isonest --plane 0,1,0,40 -o lines.png --contours 80,120,160\n"
         "isonest slice scan.isonest --plane 0,1,0,40 -o lines.vtp --contours 80,120,160"});
    c->add_option("STORE", a->extract.store, "made by isonest preprocess: a file or a URL")
        ->required();
    add_extract_options(c, a->extract);
    a->extract.is_slice = true;
    add_cells_option(c, a->extract);
    add_space_option(c, a->extract);
    add_parsed(
        c, "--plane", [a](const std::string& text) { a->plane = parse_plane(text); },
        "the plane x NX + y NY + z NZ = D, in the store's unit", "NX,NY,NZ,D")
        ->required();
    c->add_flag("--normals", a->extract.normals, "vertex normals: the plane's");
    add_parsed(
        c, "--vertex-error",
        [a](const std::string& text) {
            a->extract.vertex_error = parse_field("--vertex-error", text);
        },
        "this field at the vertices: how far they may be off", "FIELD");
    SlicePictureOptions& o = a->picture;
    add_parsed(
        c, "--size",
        [&o](const std::string& text) {
            constexpr int kMost = 4096;
            const std::vector<int> size = parse_size("--size", text, kMost);
            o.width = size[0];
            o.height = size[1];
        },
        "of the picture, pixels [800x800]", "WxH");
    c->add_option("--colors", o.colors, color_help("of the picture", "viridis"))->type_name("NAME");
    c->add_flag("--plain", o.plain, "a picture without axes and bar of the colours");
    add_parsed(
        c, "--range",
        [a](const std::string& text) {
            const std::vector<double> v = parse_numbers("--range", text, 2, "LOW,HIGH");
            if (!(v[0] < v[1])) {
                throw Error(ErrorKind::invalid_argument,
                            fmt::format("--range '{}': give the low value first", text));
            }
            a->picture.low = v[0];
            a->picture.high = v[1];
            a->has_range = true;
        },
        "values of the first and the last colour [those of the data]", "LOW,HIGH");
    c->add_flag("--grid", o.grid, "draw the triangles' edges into the picture");
    add_parsed(
        c, "--contours", [&o](const std::string& text) { o.contours = parse_contours(text); },
        "lines at these values, drawn into the picture; a mesh (.vtp, .obj)\n"
        "then holds the lines alone",
        "V,V,...");
    c->add_option("-o,--output", a->extract.mesh, "the mesh or picture to write")
        ->required()
        ->type_name("OUT");
    add_remote_options(c, a->remote);
    c->callback([a, c, &chosen] {
        for (const char* const option : {"--size", "--colors", "--plain", "--range"}) {
            if (c->get_option(option)->count() > 0) {
                a->picture_option = option;
            }
        }
        chosen.run = [a](Progress& progress) {
            require_far(a->remote, {a->extract.store});
            return run_beside_fetching(a->remote, [&] { return run(*a, progress); });
        };
        chosen.stages = {{"extract", "cutting", 0.6}, {"write mesh", "writing", 0.4}};
    });
}

}  // namespace isonest::detail::cli
