#include "tools/cli/options/extract_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string_view>

#include <isonest/error.h>

#include "query/formats/mesh_files.h"
#include "store/base/vectors.h"
#include "store/container/format.h"
#include "store/container/reader.h"
#include "tools/cli/options/units.h"
#include "tools/cli/terminal/interrupt.h"
#include "tools/drawing/canvas.h"

namespace isonest::detail::cli {
namespace {

[[noreturn]] void refuse(const std::string& option, const std::string& text, const char* first) {
    throw Error(ErrorKind::invalid_argument, fmt::format("{} '{}': there are {}{}", option, text,
                                                         first, list_names(all_fields())));
}

}  // namespace

Field parse_field(const std::string& option, const std::string& text) {
    const std::optional<Field> field = field_from_name(text);
    if (!field || *field == Field::values) {
        refuse(option, text, "");
    }
    return *field;
}

Field parse_field_or_values(const std::string& option, const std::string& text) {
    const std::optional<Field> field = field_from_name(text);
    if (!field) {
        refuse(option, text, "values, ");
    }
    return *field;
}

std::vector<Field> parse_indicators(const std::string& option, const std::string& text) {
    std::vector<Field> fields;
    for (std::size_t begin = 0; begin <= text.size();) {
        const std::size_t end = std::min(text.find(',', begin), text.size());
        const std::string name = text.substr(begin, end - begin);
        const std::vector<Field> named = indicators_from_name(name);
        if (named.empty()) {
            refuse(option, name, "nodes, all, ");
        }
        fields.insert(fields.end(), named.begin(), named.end());
        begin = end + 1;
    }
    std::sort(fields.begin(), fields.end(), precedes);
    fields.erase(std::unique(fields.begin(), fields.end()), fields.end());
    return fields;
}

std::string notes_on_names(const CLI::App& command) {
    std::string notes;
    for (const char* const name : {"--indicators", "--field", "--fields", "--stop", "--bound",
                                   "--cull-by", "--vertex-error"}) {
        const CLI::Option* const option = command.get_option_no_throw(name);
        const std::string text =
            option == nullptr || option->count() == 0 ? "" : option->results().back();
        for (std::size_t begin = 0; begin <= text.size();) {
            const std::size_t end = std::min(text.find(',', begin), text.size());
            const std::string note = note_on_name(text.substr(begin, end - begin));
            if (!note.empty() && notes.find(note) == std::string::npos) {
                notes += (notes.empty() ? "" : "\n") + note;
            }
            begin = end + 1;
        }
    }
    return notes;
}

namespace {

double parse_positive(const std::string& option, const std::string& text, bool or_zero) {
    const double value = parse_number(option, text);
    if (value < 0 || (value == 0 && !or_zero)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} '{}': give a number {} 0", option, text, or_zero ? ">=" : ">"));
    }
    return value;
}

ErrorIndicator parse_indicator(const std::string& text) {
    if (text == "deviation") {
        return ErrorIndicator::deviation;
    }
    if (text == "plus") {
        return ErrorIndicator::plus;
    }
    if (text == "estimate") {
        return ErrorIndicator::estimate;
    }
    throw Error(ErrorKind::invalid_argument,
                fmt::format("--indicator '{}': give deviation, plus or estimate", text));
}

WorldBox parse_box(const std::string& text) {
    const std::vector<double> v = parse_numbers("--box", text, 6, "x0,y0,z0,x1,y1,z1");
    return {{v[0], v[1], v[2]}, {v[3], v[4], v[5]}};
}

Focus parse_focus(const std::string& text) {
    Focus focus;
    if (std::count(text.begin(), text.end(), ',') == 2) {
        focus.lo = focus.hi = parse_double3("--focus", text);
        return focus;
    }
    const std::vector<double> v = parse_numbers("--focus", text, 6, "X,Y,Z or x0,y0,z0,x1,y1,z1");
    for (std::size_t a = 0; a < 3; ++a) {
        if (!(v[a] <= v[a + 3])) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--focus '{}': give the low corner of the box first", text));
        }
        focus.lo[a] = v[a];
        focus.hi[a] = v[a + 3];
    }
    return focus;
}

Camera& camera_of(ExtractArguments& a) {
    if (!a.camera) {
        a.camera.emplace();
    }
    return *a.camera;
}

/// REQUIRES: the option needs --stop.
FieldThreshold& stop_of(ExtractArguments& a) {
    if (!a.stop) {
        a.stop.emplace();
    }
    return *a.stop;
}

/// REQUIRES: the option needs --focus.
Focus& focus_of(ExtractArguments& a) {
    if (!a.focus) {
        a.focus.emplace();
    }
    return *a.focus;
}

/// A number, or a percentage of the range of values, at most 100 as in the library: a larger error
/// would leave nothing of the surface.
void parse_error(const std::string& option, const std::string& text, bool relative,
                 ErrorBound& error) {
    constexpr double kPercent = 100;
    const bool percent = text.ends_with('%');
    error.value = parse_positive(option, percent ? text.substr(0, text.size() - 1) : text, true);
    error.relative = relative || percent;
    error.value /= percent ? kPercent : 1;
    if (error.relative && error.value > 1) {
        const double meant = percent || error.value >= kPercent ? 1 : error.value;
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} '{}' means {:g} % of the range of the values, which leaves no "
                                "surface of the data; for {:g} % give --error-relative {:g}",
                                option, text, kPercent * error.value, meant, meant / kPercent));
    }
}

void add_error_options(CLI::App* c, ExtractArguments& a) {
    CLI::Option* const error = add_parsed(c, "--error", [&a](const std::string& text) {
        parse_error("--error", text, false, a.error);
    });
    CLI::Option* const relative = add_parsed(c, "--error-relative", [&a](const std::string& text) {
        parse_error("--error-relative", text, true, a.error);
    });
    relative->excludes(error);
    add_parsed(c, "--indicator",
               [&a](const std::string& text) { a.error.indicator = parse_indicator(text); });
    CLI::Option* const stop = add_parsed(c, "--stop", [&a](const std::string& text) {
        stop_of(a).field = parse_field("--stop", text);
    });
    stop->excludes(error)->excludes(relative);
    CLI::Option* const threshold = add_parsed(c, "--threshold", [&a](const std::string& text) {
        stop_of(a).value = parse_positive("--threshold", text, true);
    });
    add_parsed(c, "--threshold-relative",
               [&a](const std::string& text) {
                   stop_of(a).value = parse_positive("--threshold-relative", text, true);
                   stop_of(a).relative = true;
               })
        ->excludes(threshold)
        ->needs(stop);
    threshold->needs(stop);
}

void add_place_options(CLI::App* c, ExtractArguments& a) {
    CLI::Option* const focus = add_parsed(c, "--focus", [&a](const std::string& text) {
        const Focus place = parse_focus(text);
        focus_of(a).lo = place.lo;
        focus_of(a).hi = place.hi;
    });
    add_parsed(c, "--falloff", [&a](const std::string& text) {
        focus_of(a).falloff = parse_positive("--falloff", text, true);
    })->needs(focus);
    CLI::Option* const camera = add_parsed(c, "--camera", [&a](const std::string& text) {
        camera_of(a).position = parse_double3("--camera", text);
    });
    add_parsed(c, "--pixels", [&a](const std::string& text) {
        camera_of(a).pixels = parse_positive("--pixels", text, false);
    })->needs(camera);
    add_parsed(c, "--fov", [&a](const std::string& text) {
        camera_of(a).field_of_view = parse_positive("--fov", text, false);
        constexpr double kMax = 180;
        if (camera_of(a).field_of_view >= kMax) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--fov '{}': give less than 180 degrees", text));
        }
    })->needs(camera);
    add_parsed(c, "--height", [&a](const std::string& text) {
        constexpr std::int64_t kMax = 1 << 20;
        camera_of(a).height = static_cast<int>(parse_integer("--height", text, 1, kMax));
    })->needs(camera);
}

void parse_cells(const std::string& text, ExtractArguments& a) {
    if (text != "tet" && text != "hex" && text != "quad") {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("--cells '{}': give tet, hex or quad", text));
    }
    a.cells = text == "tet" ? Cells::tetrahedra : Cells::hexahedra;
    a.cells_name = text;
}

}  // namespace

void add_extract_options(CLI::App* c, ExtractArguments& a) {
    add_error_options(c, a);
    add_place_options(c, a);
    add_parsed(c, "--box", [&a](const std::string& text) { a.box = parse_box(text); });
    add_memory(c, a.options.memory);
    add_threads(c, a.options.threads);
}

std::array<double, 2> parse_range(const std::string& text) {
    // Windows of CT scans, in Hounsfield units, by their usual centres and widths. Source:
    // Radiopaedia, "Windowing (CT)", https://radiopaedia.org/articles/windowing-ct.
    struct Window {
        std::string_view name;
        double centre;
        double width;
    };
    constexpr std::array<Window, 4> kWindows{
        {{"bone", 400, 1800}, {"lung", -600, 1500}, {"soft", 50, 400}, {"brain", 40, 80}}};
    for (const Window& window : kWindows) {
        if (text == window.name) {
            return {window.centre - window.width / 2, window.centre + window.width / 2};
        }
    }
    const std::vector<double> v =
        parse_numbers("--range", text, 2, "bone, lung, soft, brain or LOW,HIGH");
    if (!(v[0] < v[1])) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("--range '{}': give the low value first", text));
    }
    return {v[0], v[1]};
}

void choose_colors(ExtractArguments& a, const std::string& attribute, double low, double high) {
    const ColorMap map(a.color_map, "--colors");
    VertexColors& colors = a.vertex_colors.emplace();
    colors.attribute = attribute;
    colors.low = a.color_range ? (*a.color_range)[0] : low;
    // Data of one value, or of none, have the first colour.
    colors.high = a.color_range ? (*a.color_range)[1]
                  : low < high  ? high
                                : std::nextafter(low, std::numeric_limits<double>::max());
    if (!std::isfinite(colors.low) || !std::isfinite(colors.high)) {
        colors.low = 0;
        colors.high = 1;
    }
    for (std::size_t i = 0; i < colors.map.size(); ++i) {
        const Rgb color = map.color(static_cast<double>(i) / 255);
        for (std::size_t part = 0; part < 3; ++part) {
            colors.map[i][part] = static_cast<std::uint8_t>(std::lround(color[part]));
        }
    }
}

void add_space_options(CLI::App* c, ExtractArguments& a) {
    add_parsed(c, "--up", [&a](const std::string& text) {
        if (text != "y" && text != "z") {
            throw Error(ErrorKind::invalid_argument, fmt::format("--up '{}': give y or z", text));
        }
        a.up = text == "y" ? UpAxis::y : UpAxis::z;
    });
    add_parsed(c, "--mesh-unit", [&a](const std::string& text) {
        a.mesh_unit = length_unit_from(text);
        if (!a.mesh_unit) {
            throw Error(ErrorKind::invalid_argument, fmt::format("--mesh-unit '{}': give one of {}",
                                                                 text, list_of_length_units()));
        }
    });
    add_parsed(c, "--space", [&a](const std::string& text) {
        const auto frame = frame_from(text);
        if (!frame && text != "as-stored") {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--space '{}': give ras, lps or as-stored", text));
        }
        a.space = !frame                           ? MeshSpace::as_stored
                  : *frame == AnatomicalFrame::ras ? MeshSpace::ras
                                                   : MeshSpace::lps;
    });
}

void add_space_json(AnatomicalFrame frame, const ExtractArguments& a, const std::string& mesh,
                    Json& json) {
    json["frame"] = frame_json(frame);
    json["space"] = frame_json(frame_in_file(frame, a.space, mesh));
    if (a.mesh_unit) {
        json["mesh_unit"] = symbol_of(*a.mesh_unit);
    }
}

std::string space_line(AnatomicalFrame frame, const ExtractArguments& a, const std::string& mesh) {
    const AnatomicalFrame written = frame_in_file(frame, a.space, mesh);
    std::string text;
    if (sign_between(frame, written) < 0) {
        text = fmt::format(
            "positions are in {}: those of the volume, which are in {}, with x and y "
            "negated\n",
            name_of(written), name_of(frame));
    }
    if (a.mesh_unit) {
        text += fmt::format(
            "positions in the file are in {}, but everything reported here is in "
            "the unit of the volume\n",
            symbol_of(*a.mesh_unit));
    }
    return text;
}

void add_cells_option(CLI::App* c, ExtractArguments& a) {
    add_parsed(c, "--cells", [&a](const std::string& text) { parse_cells(text, a); });
}

void require_suitable_cells(const ExtractArguments& a) {
    if (a.cells_name == "quad" && !a.is_graph) {
        throw Error(ErrorKind::invalid_argument,
                    a.is_slice ? "--cells quad: a slice has hexahedral cells; give --cells hex"
                               : "--cells quad needs --graph; for surfaces give --cells hex");
    }
    if (a.cells_name == "hex" && a.is_graph) {
        throw Error(ErrorKind::invalid_argument,
                    "--cells hex cannot be combined with --graph; give --cells quad");
    }
}

bool is_guaranteed(const ExtractReport& r) {
    return is_bound(r.traversal.stop) && r.traversal.stop != Field::grad_linf_plus;
}

std::string function_text(const ExtractReport& r) {
    if (r.traversal.cells == Cells::hexahedra) {
        return r.dimension == 2 ? "the bilinear function on quadrilaterals"
                                : "the trilinear function on hexahedra";
    }
    return r.dimension == 2 ? "the piecewise linear function on triangles"
                            : "the piecewise linear function on tetrahedra";
}

std::string rounding_note(const Store& store) {
    const DataRounding rounding = store.rounding();
    return rounding.none()
               ? ""
               : fmt::format("the store's values are rounded within {:.6g}\n", rounding.tolerance);
}

std::string rounded_text(const ExtractReport& r) {
    return r.data_tolerance > 0
               ? fmt::format("; the store's values are rounded within {:.6g}, which the {}",
                             r.data_tolerance,
                             r.distance ? "distance does not include" : "error includes")
               : "";
}

std::string guarantee_text(const ExtractArguments& a, const ExtractReport& r) {
    const auto asked = [&] {
        const bool is_part = a.is_slice || a.is_graph;
        return fmt::format(
            "{:.6g} (asked for {:.6g}{}{})", r.error_bound, r.tolerance,
            a.focus ? " in the focus" : "",
            is_part && r.value_rounding > 0
                ? fmt::format("; {:.2g} of it rounds {}", r.value_rounding,
                              a.is_graph ? "heights to 32-bit floats" : "the vertices' values")
                : "");
    };
    const bool is_surface = !a.is_slice && !a.is_graph;
    if (is_surface && r.error_bound == r.data_tolerance && r.tolerance == 0) {
        const std::string full = "the surface at full resolution, of " + function_text(r);
        return r.data_tolerance > 0
                   ? full + fmt::format(
                                "; error at most {:.6g}, because the store's values are "
                                "rounded",
                                r.data_tolerance)
                   : full;
    }
    const Field stop = r.traversal.stop;
    if (is_guaranteed(r) || stop == Field::hex_deviation) {
        return fmt::format("error at most {}, of {}{}", asked(), function_text(r), rounded_text(r));
    }
    if ((stop == Field::linf_bar || stop == Field::hex_linf) && !a.stop) {
        return "estimated error " + asked() + rounded_text(r);
    }
    const std::string what =
        stop == Field::grad_linf_plus     ? "bounds the error of the gradient, not of the value"
        : stop == Field::normal_turn_plus ? "bounds the error of the unit normal, not of the value"
                                          : "does not bound the error of the value";
    return fmt::format("{} below {:.6g} (largest {:.6g}): {}", name_of(stop), r.tolerance,
                       r.error_bound, what);
}

std::string version_text(const std::string& mesh) {
    // PolyData was added in version 2.0 of the VTKHDF format.
    return std::filesystem::path(mesh).extension() == ".vtkhdf"
               ? "Reading it takes VTK 9.3 or ParaView 5.12, or newer; all versions read .vtp.\n"
               : "";
}

std::string extract_warning(const ExtractArguments& a, const ExtractReport& r) {
    constexpr double kNoticeable = 0.01;
    // Those of tiles are known when the folder is complete (MeshOutput::finish()).
    std::string warning = a.tiles ? "" : leftovers_of(a.mesh);
    if (r.triangles > 0 && r.coordinate_rounding > kNoticeable) {
        warning += warning.empty() ? "" : "\n";
        warning += fmt::format(
            "{}: its coordinates are so far from 0 that 32-bit floats round them by up to {:.2g} "
            "of the distance between nodes, on top of the error; preprocess with an --origin near "
            "0",
            a.mesh, r.coordinate_rounding);
    }
    if (r.triangles > 0 && r.value_rounding > r.tolerance &&
        r.value_rounding > kNoticeable * r.value_range) {
        warning += warning.empty() ? "" : "\n";
        warning +=
            fmt::format("{}: 32-bit floats round its {} by up to {:.2g}, of a range of {:.2g}: {}",
                        a.mesh, a.is_graph ? "heights" : "values", r.value_rounding, r.value_range,
                        a.is_graph ? "subtract an offset from the data before preprocess"
                                   : "write .ply, .vtp or .vtkhdf, which hold 64-bit values");
    }
    return warning;
}

bool reaches_volume(const Store& store, const WorldBox& box) {
    const StoreHeader& h = store.reader().layout().header();
    const Double3 last = last_position(h);
    for (std::size_t a = 0; a < 3; ++a) {
        const bool flat = h.nodes[static_cast<int>(a)] == 1;
        if (!flat && (box.hi[a] <= h.origin[a] || box.lo[a] >= last[a])) {
            return false;
        }
    }
    return true;
}

std::string range_text(const Store& store) {
    const StoreReader& reader = store.reader();
    return reader.layout().header().labels
               ? value_text(true, reader.min_value(), reader.max_value())
               : human_range(reader.min_value(), reader.max_value());
}

std::string volume_text(const Store& store) {
    const StoreHeader& h = store.reader().layout().header();
    const Double3 last = rotated_about(h.origin, h.rotation(), last_position(h));
    return fmt::format("which lies between {:.6g},{:.6g},{:.6g} and {:.6g},{:.6g},{:.6g}",
                       h.origin[0], h.origin[1], h.origin[2], last[0], last[1], last[2]);
}

ExtractOptions options_of(const ExtractArguments& a) {
    ExtractOptions options = a.options;
    const std::filesystem::path folder = std::filesystem::path(a.mesh).parent_path();
    options.scratch = folder.empty() ? "." : folder;
    return options;
}

std::string manifold_text(const ExtractReport& r) {
    if (!r.manifold || r.triangles == 0) {
        return "";
    }
    const auto& [edges, vertices, copies] = *r.manifold;
    std::string text;
    if (copies > 0) {
        text += fmt::format("{} vertices were added where the surface touches itself.\n", copies);
    }
    if (edges > 0 || vertices > 0) {
        text += fmt::format(
            "The surface touches itself in {} edges with more than two triangles and {} vertices{}."
            "\n",
            edges, vertices, copies > 0 ? "" : "; --manifold separates them");
    }
    return text;
}

void add_manifold_json(const ExtractReport& r, Json& json) {
    if (r.manifold) {
        json["nonmanifold_edges"] = r.manifold->edges;
        json["nonmanifold_vertices"] = r.manifold->vertices;
        json["split_vertices"] = r.manifold->copies;
    }
}

Json extract_json(const ExtractArguments& a, const ExtractReport& r) {
    const std::string cells = r.traversal.cells == Cells::hexahedra ? "hexahedra" : "tetrahedra";
    Json json = {{"mesh", a.mesh},
                 {"vertices", r.vertices},
                 {"triangles", r.triangles},
                 {"stop", name_of(r.traversal.stop)},
                 {"bound", name_of(r.traversal.bound)},
                 {"tolerance", r.tolerance},
                 {"error_bound", r.error_bound},
                 {"data_tolerance", r.data_tolerance},
                 {"value_rounding", r.value_rounding},
                 {"guaranteed", is_guaranteed(r) || r.traversal.stop == Field::hex_deviation},
                 {"cells", cells},
                 {"function", r.traversal.cells != Cells::hexahedra ? "piecewise linear"
                              : r.dimension == 2                    ? "bilinear"
                                                                    : "trilinear"},
                 {"visited_" + cells, r.traversal.visited},
                 {"leaf_" + cells, r.traversal.leaves},
                 {"mended_triangles", r.mending.mended},
                 {"zero_area_triangles", r.mending.zero_area},
                 {"apart_vertices", r.apart.moved},
                 {"together_vertices", r.apart.together},
                 {"coordinate_rounding", r.coordinate_rounding},
                 {"chunks_read", r.traversal.chunks_read},
                 {"chunks_total", r.traversal.chunks_total},
                 {"bytes_read", r.traversal.bytes_read},
                 {"peak_cache_bytes", r.traversal.peak_cache_bytes},
                 {"bricks", r.traversal.bricks},
                 {"seconds", r.seconds}};
    if (r.measures) {
        json["area"] = r.measures->area;
        json["volume"] = r.measures->volume ? Json(*r.measures->volume) : Json();
    }
    add_manifold_json(r, json);
    if (r.quality) {
        json["smallest_angle"] = {
            {"min", r.quality->least},     {"q0.1%", r.quality->per_mille},
            {"q1%", r.quality->percent},   {"q5%", r.quality->five_percent},
            {"median", r.quality->median}, {"share_below_5", r.quality->narrow_share}};
    }
    if (const auto& culled_by = r.traversal.culled_by) {
        json["culled_by"] = name_of(*culled_by);
    }
    return json;
}

}  // namespace isonest::detail::cli
