// isonest slice: cuts the data with a plane; writes a mesh, a picture or contour lines.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/mesh_file.h>

#include "query/extract/extract_query.h"
#include "store/container/format.h"
#include "store/container/reader.h"
#include "store/files/output_file.h"
#include "tools/cli/commands/input_store.h"
#include "tools/cli/commands/series_command.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"
#include "tools/drawing/canvas.h"
#include "tools/drawing/slice_picture.h"

namespace isonest::detail::cli {
namespace {

struct SliceArguments {
    ExtractArguments extract;
    WorldPlane plane;
    SlicePictureOptions picture;  ///< its contours are used even if no picture is drawn
    std::string picture_option;   ///< an option given for the picture, or empty
    std::string color_option;     ///< an option given for colours, or empty
    std::string times;            ///< the steps of a series; empty: all
    InputArguments in;
};

/// Whether the plane intersects the volume.
bool meets_volume(const Store& store, const WorldPlane& plane) {
    const StoreHeader& h = store.reader().layout().header();
    const WorldPlane own = in_own_axes(plane, h);
    const Double3 last = last_position(h);
    const Double3 changes = h.steps().changes(own.normal);
    double low = -own.offset;
    double high = low;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const double from = own.normal[axis] * h.origin[axis];
        const double to =
            h.is_sheared()
                ? from + changes[axis] * static_cast<double>(h.nodes[static_cast<int>(axis)] - 1)
                : own.normal[axis] * last[axis];
        low += std::min(from, to);
        high += std::max(from, to);
    }
    return low <= 0 && high >= 0;
}

/// Explains why the slice is empty. `is_lines`: contour lines were requested.
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
            "There are no lines: the contour values do not occur in the plane{}; the values of the "
            "volume are {}.\n",
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
                    "--contours and --cells cannot be combined in a mesh: its lines are extracted "
                    "from tetrahedra");
    }
    if (a.extract.normals || a.extract.vertex_error) {
        throw Error(ErrorKind::invalid_argument,
                    "--contours cannot be combined with --normals or --vertex-error in a mesh");
    }
    auto query = a.extract.query<ContourQuery>();
    query.plane = a.plane;
    query.values = a.picture.contours;
    const auto sink = open_mesh_file(a.extract.mesh, a.extract.file_options());
    return extract(store, query, *sink, options_of(a.extract), progress);
}

SliceQuery slice_query(const SliceArguments& a) {
    auto query = a.extract.query<SliceQuery>();
    query.plane = a.plane;
    query.cells = a.extract.cells.value_or(Cells::tetrahedra);
    query.attributes = {a.extract.normals, nullptr, a.extract.vertex_error};
    return query;
}

ExtractReport run_slice(const Store& store, const SliceArguments& a, MeshSink& sink,
                        Progress& progress) {
    return extract(store, slice_query(a), sink, options_of(a.extract), progress);
}

Result slice_store(const Store& store, SliceArguments& a, Progress& progress) {
    a.picture.low = a.extract.color_range ? (*a.extract.color_range)[0] : store.min_value();
    a.picture.high = a.extract.color_range ? (*a.extract.color_range)[1] : store.max_value();
    const bool picture = is_png(a.extract.mesh);
    const bool lines = !picture && !a.picture.contours.empty();
    if (!picture && a.picture.grid) {
        throw Error(ErrorKind::invalid_argument, {a.extract.mesh},
                    "--grid needs a picture: give a name that ends with .png");
    }
    if (picture && a.extract.mesh_unit) {
        throw Error(ErrorKind::invalid_argument, {a.extract.mesh},
                    "--mesh-unit needs a mesh, and this is a picture");
    }
    if (picture && (a.extract.space != MeshSpace::automatic || a.extract.up != UpAxis::z)) {
        throw Error(ErrorKind::invalid_argument, {a.extract.mesh},
                    fmt::format("{} needs a mesh, and this is a picture",
                                a.extract.up != UpAxis::z ? "--up" : "--space"));
    }
    if (lines && !a.color_option.empty()) {
        throw Error(ErrorKind::invalid_argument, {a.extract.mesh},
                    a.color_option +
                        " is for pictures and meshes of triangles, not for the lines "
                        "of --contours");
    }
    ExtractReport r;
    if (picture && (a.extract.normals || a.extract.vertex_error)) {
        throw Error(ErrorKind::invalid_argument, {a.extract.mesh},
                    fmt::format("{} needs a mesh, and this is a picture",
                                a.extract.normals ? "--normals" : "--vertex-error"));
    }
    if (!picture && !a.picture_option.empty()) {
        throw Error(ErrorKind::invalid_argument, {a.extract.mesh},
                    a.picture_option + " needs a picture: give an --output that ends with .png");
    }
    if (picture) {
        a.picture.normal = a.plane.normal;
        // Drawing takes a quarter; the parts of the mesh share the rest.
        a.picture.memory = a.extract.options.memory / 4;
        SlicePicture sink(a.extract.mesh, a.picture);
        r = run_slice(store, a, sink, progress);
    } else if (lines) {
        r = run_contours(store, a, progress);
    } else {
        if (!a.color_option.empty()) {
            a.extract.color_map = a.picture.colors;
            choose_colors(a.extract, "value", store.min_value(), store.max_value());
        }
        const auto sink = open_mesh_file(a.extract.mesh, a.extract.file_options());
        r = run_slice(store, a, *sink, progress);
    }
    Result result;
    result.warning = extract_warning(a.extract, r);
    if (store.reader().label_names().size() > 0) {
        result.warning += result.warning.empty() ? "" : "\n";
        result.warning += fmt::format(
            "{}: its values are named labels, and a slice interpolates between nodes: between "
            "labels 1 and 3 it would show 2; isonest export writes the labels themselves",
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
    return result;
}

/// Throws for names with the extension of a picture format other than PNG.
void require_png(const std::string& name) {
    constexpr std::array kPictures{".jpg",  ".jpeg", ".gif", ".bmp", ".tif",
                                   ".tiff", ".webp", ".svg", ".pdf"};
    std::filesystem::path path(name);
    const std::string end = lower_extension(path);
    if (std::find(kPictures.begin(), kPictures.end(), end) != kPictures.end()) {
        throw Error(ErrorKind::invalid_argument, {name},
                    fmt::format("pictures are written as .png: give -o {}",
                                path.replace_extension(".png").string()));
    }
}

Result run(SliceArguments& a, Progress& progress) {
    if (const std::optional<Series> series = open_if_series(a.in, nullptr)) {
        return write_steps(
            *series, std::exchange(a.times, ""), a.extract.mesh, {}, progress,
            [&](const std::string& store, const std::string& file, Progress& step_progress) {
                SliceArguments own = a;
                own.in.input = {store};
                own.extract.mesh = file;
                return run(own, step_progress);
            });
    }
    require_no_times(a.times, a.in.shown());
    require_png(a.extract.mesh);
    require_suitable_cells(a.extract);
    ExtractOptions& options = a.extract.options;
    const InputStore input = open_or_make_store(
        a.in, {{}, a.extract.mesh, fields_needed(slice_query(a)), 0, options.threads},
        options.memory, progress);
    a.extract.store = input.name();
    Result result = run_on(input, [&] { return slice_store(input.store(), a, progress); });
    input.report(result);
    return result;
}

WorldPlane parse_plane(const std::string& text) {
    const std::vector<double> v = parse_numbers("--plane", text, 4, "NX,NY,NZ,D");
    return {{v[0], v[1], v[2]}, v[3]};
}

/// The last of the options that is given; empty if none is.
std::string last_given(const CLI::App& command, std::initializer_list<const char*> options) {
    std::string last;
    for (const char* const option : options) {
        if (command.get_option(option)->count() > 0) {
            last = option;
        }
    }
    return last;
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
        {"Write a plane through the data as a coloured mesh or a picture",
         "The slice consists of triangles as large as the error allows; the vertices "
         "of a mesh have values. The extension of OUT selects a picture (.png) or a "
         "mesh. For a volume, a temporary store is made; --keep-store keeps it. For "
         "a series, {time} or {step} in the name makes a picture or mesh for each step.",
         "isonest slice scan.isonest --plane 0,0,1,35 --error 2 -o slice.png --grid\n"
         "isonest slice scan.nrrd --plane 0,0,1,35 -o slice.png\n"
         "isonest slice scan.isonest --plane 1,1,0,90 --error 2% -o oblique.vtp\n"
         "isonest slice run.isonest --plane 0,0,1,35 -o film_{step}.png\n"
         "isonest slice scan.isonest --plane 0,1,0,40 --contours 80,120 -o lines.vtp"});
    add_input_options(c, a->in, false);
    add_extract_options(c, a->extract);
    a->extract.is_slice = true;
    add_cells_option(c, a->extract);
    add_space_options(c, a->extract);
    add_parsed(c, "--plane", [a](const std::string& text) {
        a->plane = parse_plane(text);
    })->required();
    c->add_flag("--normals", a->extract.normals);
    add_parsed(c, "--vertex-error", [a](const std::string& text) {
        a->extract.vertex_error = parse_field("--vertex-error", text);
    });
    SlicePictureOptions& o = a->picture;
    add_parsed(
        c, "--size",
        [&o](const std::string& text) {
            constexpr int kMax = 4096;
            const std::vector<int> size = parse_size("--size", text, kMax);
            o.width = size[0];
            o.height = size[1];
        },
        "800x800");
    c->add_option("--colors", o.colors);
    c->add_flag("--plain", o.plain);
    add_parsed(c, "--range",
               [a](const std::string& text) { a->extract.color_range = parse_range(text); });
    c->add_flag("--grid", o.grid);
    add_parsed(c, "--contours",
               [&o](const std::string& text) { o.contours = parse_contours(text); });
    c->add_option("--times", a->times);
    c->add_option("-o,--output", a->extract.mesh)->required();
    c->callback([a, c, &chosen] {
        note_source_option(*c, a->in);
        a->picture_option = last_given(*c, {"--size", "--plain"});
        a->color_option = last_given(*c, {"--range", "--colors"});
        chosen.run = [a](Progress& progress) {
            return run_beside_fetching(a->in.remote, a->in.input,
                                       [&] { return run(*a, progress); });
        };
        if (!is_series(a->in.input.front())) {
            chosen.stages =
                with_store_stages({{"extract", "cutting", 0.6}, {"write mesh", "writing", 0.4}});
        }
    });
}

}  // namespace isonest::detail::cli
