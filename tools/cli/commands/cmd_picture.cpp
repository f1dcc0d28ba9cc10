// isonest picture: renders a shaded picture of a mesh.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/open_volume.h>

#include "store/files/output_file.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"
#include "tools/cli/terminal/interrupt.h"
#include "tools/drawing/canvas.h"
#include "tools/drawing/input/mesh_input.h"
#include "tools/drawing/input/ply_reader.h"
#include "tools/drawing/picture.h"

namespace isonest::detail::cli {
namespace {

struct PictureArguments {
    std::string mesh;
    std::string png;
    Double3 view = PictureView{}.view;
    int turntable = 0;  ///< number of pictures; 0: a single picture, written to the given name
    std::string by = "value";
    PictureOptions options;
    const char* value_option = "";  ///< an option given for drawing values, or empty
    bool has_color = false;         ///< --color was given
};

constexpr int kMaxViews = 3600;

Double3 parse_view(const std::string& text) {
    const std::array<std::pair<const char*, Double3>, 7> names{{{"front", {0, -1, 0}},
                                                                {"back", {0, 1, 0}},
                                                                {"left", {-1, 0, 0}},
                                                                {"right", {1, 0, 0}},
                                                                {"top", {0, 0, 1}},
                                                                {"bottom", {0, 0, -1}},
                                                                {"iso", {1, -1, 1}}}};
    for (const auto& [name, view] : names) {
        if (text == name) {
            return view;
        }
    }
    if (std::count(text.begin(), text.end(), ',') == 1) {
        const std::vector<double> angles = parse_numbers("--view", text, 2, "TURN,HEIGHT");
        const double turn = angles[0] * std::numbers::pi / 180;
        const double height = angles[1] * std::numbers::pi / 180;
        return {std::sin(turn) * std::cos(height), -std::cos(turn) * std::cos(height),
                std::sin(height)};
    }
    const Double3 view = parse_double3("--view", text);
    if (std::hypot(view[0], view[1], view[2]) == 0) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("--view '{}': give a direction other than 0,0,0", text));
    }
    return view;
}

/// A single view, or the views of a turntable around the vertical axis (name_000.png and so on).
std::vector<PictureView> views_of(const PictureArguments& a) {
    if (a.turntable == 0) {
        return {{a.png, a.view}};
    }
    std::vector<PictureView> views;
    const std::filesystem::path png = a.png;
    for (int k = 0; k < a.turntable; ++k) {
        const double turn = 2 * std::numbers::pi * k / a.turntable;
        std::filesystem::path name = png;
        name.replace_filename(
            fmt::format("{}_{:03}{}", png.stem().string(), k, png.extension().string()));
        views.push_back({name,
                         {a.view[0] * std::cos(turn) - a.view[1] * std::sin(turn),
                          a.view[0] * std::sin(turn) + a.view[1] * std::cos(turn), a.view[2]}});
    }
    return views;
}

/// Opens the mesh of `a`. If the file is a volume or a store, the error says how to make a mesh
/// from it.
PlyMesh mesh_of(const PictureArguments& a, Progress& progress) {
    const std::filesystem::path folder = std::filesystem::path(a.png).parent_path();
    try {
        return open_mesh(a.mesh, a.by, folder.empty() ? std::filesystem::path(".") : folder,
                         progress);
    } catch (const Error& error) {
        const std::string format =
            error.kind() == ErrorKind::corrupt ? input_format_of(a.mesh) : std::string();
        if (format.empty()) {
            throw;
        }
        throw Error(ErrorKind::invalid_argument, {a.mesh},
                    fmt::format("a volume or store ({}), not a mesh; extract a surface first: "
                                "isonest extract {} --iso V -o surface.ply",
                                format, a.mesh));
    }
}

Result run(const PictureArguments& a, Progress& progress) {
    if (!is_png(a.png)) {
        throw Error(ErrorKind::invalid_argument, {a.png}, "pictures are written as .png");
    }
    const std::vector<PictureView> views = views_of(a);
    for (const PictureView& view : views) {
        check_output(view.png, true, {a.mesh});
    }
    const PlyMesh mesh = mesh_of(a, progress);
    if (a.by != "value" && a.by != "none" && !mesh.has_values()) {
        throw Error(ErrorKind::not_found, {a.mesh},
                    fmt::format("its vertices have no property {}", a.by));
    }
    const bool has_values = mesh.has_values() && a.options.by_values;
    if (a.value_option[0] != 0 && !has_values) {
        throw Error(ErrorKind::invalid_argument, {a.mesh},
                    fmt::format("{}: it is drawn without values", a.value_option));
    }
    if (a.has_color && has_values) {
        throw Error(ErrorKind::invalid_argument, {a.mesh},
                    "--color needs --color-by none: the values of this mesh define its colours");
    }
    const PictureReport r = draw_pictures(mesh, views, a.options, progress);
    Result result;
    result.json = {{"picture", a.png},
                   {"width", a.options.width},
                   {"height", a.options.height},
                   {"vertices", mesh.vertices()},
                   {"triangles", mesh.triangles()},
                   {"shading", r.smooth ? "smooth" : "flat"},
                   {"lo", r.lo},
                   {"hi", r.hi}};
    if (r.range) {
        result.json["range"] = {r.range->first, r.range->second};
    }
    const std::string name = views.size() == 1 ? a.png
                                               : fmt::format("{} to {}", views.front().png.string(),
                                                             views.back().png.filename().string());
    result.text = fmt::format("{}: {} x {} pixels, {} triangles\n", name, a.options.width,
                              a.options.height, mesh.triangles());
    result.warning = leftovers_of(a.png);
    if (mesh.triangles() == 0) {
        result.warning += result.warning.empty() ? "" : "\n";
        result.warning += fmt::format("{} has no triangles: the picture is empty", a.mesh);
    }
    return result;
}

}  // namespace

void add_picture(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<PictureArguments>();
    CLI::App* const c =
        add_command(app, chosen, "picture",
                    {"Draw a mesh as a PNG",
                     "MESH is a triangle mesh, as isonest extract writes it. It is shaded and "
                     "fitted to the picture, with z up; the side facing larger values is paler and "
                     "warmer. The colours are those of the vertices, or represent their values.",
                     "isonest picture surface.ply -o surface.png\n"
                     "isonest picture surface.ply -o edges.png --wireframe --size 1600x1200\n"
                     "isonest picture surface.ply -o top.png --view top --color 200,120,90\n"
                     "isonest picture surface.ply -o around.png --turntable 36\n"
                     "isonest picture surface.ply -o error.png --color-by error --colors magma"});
    PictureOptions& o = a->options;
    c->add_option("MESH", a->mesh)->required();
    c->add_option("-o,--output", a->png)->required();
    add_parsed(
        c, "--size",
        [&o](const std::string& text) {
            const std::vector<int> size = parse_size("--size", text, kMaxPixels);
            o.width = size[0];
            o.height = size[1];
        },
        "800x600");
    add_parsed(c, "--view", [a](const std::string& text) { a->view = parse_view(text); });
    add_parsed(c, "--turntable", [a](const std::string& text) {
        a->turntable = static_cast<int>(parse_integer("--turntable", text, 1, kMaxViews));
    });
    c->add_flag("--wireframe", o.wireframe);
    c->add_flag("--flat", o.flat);
    c->add_flag("--plain", o.plain);
    add_parsed(c, "--color-by", [a](const std::string& text) {
        a->by = text;
        a->options.by_values = text != "none";
    });
    c->add_option("--colors", o.colors);
    add_parsed(c, "--range", [&o](const std::string& text) {
        const std::vector<double> v = parse_numbers("--range", text, 2, "LOW,HIGH");
        if (!(v[0] < v[1])) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--range '{}': give the low value first", text));
        }
        o.range = {v[0], v[1]};
    });
    add_parsed(c, "--color", [&o](const std::string& text) {
        const std::vector<double> rgb = parse_numbers("--color", text, 3, "R,G,B");
        for (std::size_t i = 0; i < 3; ++i) {
            if (rgb[i] < 0 || rgb[i] > 255) {
                throw Error(ErrorKind::invalid_argument,
                            fmt::format("--color '{}': give numbers from 0 to 255", text));
            }
            o.color.at(i) = static_cast<int>(rgb[i]);
        }
    });
    add_memory(c, o.memory);
    c->callback([a, c, &chosen] {
        for (const char* const option : {"--colors", "--range"}) {
            a->value_option = c->get_option(option)->count() > 0 ? option : a->value_option;
        }
        a->has_color = c->get_option("--color")->count() > 0;
        chosen.run = [a](Progress& progress) { return run(*a, progress); };
    });
}

}  // namespace isonest::detail::cli
