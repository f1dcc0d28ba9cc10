#include "tools/cli/options/extract_options.h"

#include <fmt/format.h>

#include <algorithm>

#include <isonest/error.h>

#include "query/formats/mesh_files.h"
#include "store/base/rotation.h"
#include "store/container/extent.h"
#include "store/container/reader.h"
#include "tools/cli/options/fields.h"
#include "tools/cli/options/units.h"
#include "tools/cli/terminal/leftovers.h"

namespace isonest::detail::cli {
namespace {

double parse_positive(const std::string& option, const std::string& text, bool or_zero) {
    const double value = parse_number(option, text);
    if (value < 0 || (value == 0 && !or_zero)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} '{}': give a number {} 0", option, text, or_zero ? ">=" : ">"));
    }
    return value;
}

Guarantee parse_guarantee(const std::string& text) {
    if (text == "deviation") {
        return Guarantee::deviation;
    }
    if (text == "plus") {
        return Guarantee::plus;
    }
    if (text == "estimate") {
        return Guarantee::estimate;
    }
    throw Error(ErrorKind::invalid_argument,
                fmt::format("--guarantee '{}': give deviation, plus or estimate", text));
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

void add_error_options(CLI::App* c, ExtractArguments& a) {
    CLI::Option* const error = add_parsed(
        c, "--error",
        [&a](const std::string& text) { a.error.value = parse_positive("--error", text, true); },
        "largest error of the value, in units of the data [0]", "E");
    CLI::Option* const relative = add_parsed(
        c, "--error-relative",
        [&a](const std::string& text) {
            a.error.value = parse_positive("--error-relative", text, true);
            a.error.relative = true;
        },
        "the same, as a fraction of the data's range", "R");
    relative->excludes(error);
    add_parsed(
        c, "--guarantee",
        [&a](const std::string& text) { a.error.guarantee = parse_guarantee(text); },
        "deviation (a bound, tight), plus (a bound, looser) or\n"
        "estimate (no bound, usually close) [deviation]",
        "NAME");
    CLI::Option* const stop = add_parsed(
        c, "--stop",
        [&a](const std::string& text) { stop_of(a).field = parse_field("--stop", text); },
        "in place of the error: refine while this field of the store\n"
        "is not below the threshold",
        "FIELD");
    stop->excludes(error)->excludes(relative);
    CLI::Option* const threshold = add_parsed(
        c, "--threshold",
        [&a](const std::string& text) {
            stop_of(a).value = parse_positive("--threshold", text, true);
        },
        "in the field's own units [0]", "T");
    add_parsed(
        c, "--threshold-relative",
        [&a](const std::string& text) {
            stop_of(a).value = parse_positive("--threshold-relative", text, true);
            stop_of(a).relative = true;
        },
        "as a fraction of the field's largest value", "T")
        ->excludes(threshold)
        ->needs(stop);
    threshold->needs(stop);
}

void add_place_options(CLI::App* c, ExtractArguments& a) {
    CLI::Option* const focus = add_parsed(
        c, "--focus",
        [&a](const std::string& text) {
            const Focus place = parse_focus(text);
            focus_of(a).lo = place.lo;
            focus_of(a).hi = place.hi;
        },
        "the error holds at this point or in this box, and may grow\n"
        "with the distance to it, by --falloff",
        "X,Y,Z[,X1,Y1,Z1]");
    add_parsed(
        c, "--falloff",
        [&a](const std::string& text) {
            focus_of(a).falloff = parse_positive("--falloff", text, true);
        },
        "the error at distance d from the focus is 1 + F d times as large [0]", "F")
        ->needs(focus);
    CLI::Option* const camera = add_parsed(
        c, "--camera",
        [&a](const std::string& text) { camera_of(a).position = parse_double3("--camera", text); },
        "stop as well where a viewer at this place sees less than\n"
        "--pixels of a diamond of elements",
        "X,Y,Z");
    add_parsed(
        c, "--pixels",
        [&a](const std::string& text) {
            camera_of(a).pixels = parse_positive("--pixels", text, false);
        },
        "size in the picture below which nothing is refined [1]", "N")
        ->needs(camera);
    add_parsed(
        c, "--fov",
        [&a](const std::string& text) {
            camera_of(a).field_of_view = parse_positive("--fov", text, false);
            constexpr double kMost = 180;
            if (camera_of(a).field_of_view >= kMost) {
                throw Error(ErrorKind::invalid_argument,
                            fmt::format("--fov '{}': give less than 180 degrees", text));
            }
        },
        "the camera's angle from top to bottom, degrees [40]", "DEG")
        ->needs(camera);
    add_parsed(
        c, "--height",
        [&a](const std::string& text) {
            constexpr std::int64_t kMost = 1 << 20;
            camera_of(a).height = static_cast<int>(parse_integer("--height", text, 1, kMost));
        },
        "the picture's height in pixels [1080]", "PIXELS")
        ->needs(camera);
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
    add_parsed(
        c, "--box", [&a](const std::string& text) { a.box = parse_box(text); },
        "only what is inside this box, numbers in the store's unit", "x0,y0,z0,x1,y1,z1");
    add_memory(c, a.options.memory);
    add_threads(c, a.options.threads);
}

void add_space_option(CLI::App* c, ExtractArguments& a) {
    add_parsed(
        c, "--space",
        [&a](const std::string& text) {
            const auto frame = frame_from(text);
            if (!frame && text != "as-stored") {
                throw Error(ErrorKind::invalid_argument,
                            fmt::format("--space '{}': give ras, lps or as-stored", text));
            }
            a.space = !frame                           ? MeshSpace::as_stored
                      : *frame == AnatomicalFrame::ras ? MeshSpace::ras
                                                       : MeshSpace::lps;
        },
        "patient axes of the mesh's positions; what other options take and say\n"
        "is as stored [ras where the volume's axes are known, else as-stored]",
        "ras|lps|as-stored");
}

void add_space_json(AnatomicalFrame frame, const ExtractArguments& a, const std::string& mesh,
                    Json& json) {
    json["frame"] = frame_json(frame);
    json["space"] = frame_json(frame_in_file(frame, a.space, mesh));
}

std::string space_line(AnatomicalFrame frame, const ExtractArguments& a, const std::string& mesh) {
    const AnatomicalFrame written = frame_in_file(frame, a.space, mesh);
    return sign_between(frame, written) < 0
               ? fmt::format("positions are in {}: the volume's, in {}, with x and y negated\n",
                             name_of(written), name_of(frame))
               : "";
}

void add_cells_option(CLI::App* c, ExtractArguments& a) {
    add_parsed(
        c, "--cells", [&a](const std::string& text) { parse_cells(text, a); },
        "cells of the nested grid: tetrahedra (triangles of data in a\n"
        "plane), or hexahedra, which give a third of the triangles; an\n"
        "error above 0 then needs hex_deviation, an estimate hex_linf.\n"
        "quad: of --graph, quadrilaterals by the same fields [tet; within\n"
        "a distance hex, unless another option goes with tet alone]",
        "tet|hex|quad");
}

void require_suitable_cells(const ExtractArguments& a) {
    if (a.cells_name == "quad" && !a.is_graph) {
        throw Error(ErrorKind::invalid_argument,
                    "--cells quad: quadrilaterals are of --graph; surfaces and slices of volumes "
                    "have --cells hex");
    }
    if (a.cells_name == "hex" && a.is_graph) {
        throw Error(ErrorKind::invalid_argument,
                    "--cells hex: a graph is of data in a plane, whose cells are --cells quad");
    }
}

bool is_guaranteed(const ExtractReport& r) {
    return is_bound(r.traversal.stop) && r.traversal.stop != Field::grad_linf_plus;
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
    if (is_guaranteed(r)) {
        return "error at most " + asked();
    }
    const Field stop = r.traversal.stop;
    if (stop == Field::hex_deviation) {
        return "error of the trilinear function at most " + asked();
    }
    if ((stop == Field::linf_bar || stop == Field::hex_linf) && !a.stop) {
        return "estimated error " + asked();
    }
    const std::string what = stop == Field::grad_linf_plus
                                 ? "a bound on the gradient's error, none on the value's"
                             : stop == Field::normal_turn_plus
                                 ? "a bound on the unit normal's error, none on the value's"
                                 : "no bound on the value's error";
    return fmt::format("{} below {:.6g} (largest {:.6g}): {}", name_of(stop), r.tolerance,
                       r.error_bound, what);
}

std::string version_text(const std::string& mesh) {
    // PolyData came to VTKHDF with version 2.0 of the format.
    return std::filesystem::path(mesh).extension() == ".vtkhdf"
               ? "VTK 9.3 and ParaView 5.12 read it, or newer ones; .vtp is for all.\n"
               : "";
}

std::string extract_warning(const ExtractArguments& a, const ExtractReport& r) {
    constexpr double kNoticeable = 0.01;
    std::string warning = leftovers_of(a.mesh);
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
                        a.is_graph ? "take an offset off the data before preprocess"
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
    const Double3 last = rotated_about(h.origin, h.direction, last_position(h));
    return fmt::format("which lies between {:.6g},{:.6g},{:.6g} and {:.6g},{:.6g},{:.6g}",
                       h.origin[0], h.origin[1], h.origin[2], last[0], last[1], last[2]);
}

ExtractOptions options_of(const ExtractArguments& a) {
    ExtractOptions options = a.options;
    const std::filesystem::path folder = std::filesystem::path(a.mesh).parent_path();
    options.scratch = folder.empty() ? "." : folder;
    return options;
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
                 {"value_rounding", r.value_rounding},
                 {"guaranteed", is_guaranteed(r) || r.traversal.stop == Field::hex_deviation},
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
