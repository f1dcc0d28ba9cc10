// isonest picture: a shaded picture of a mesh.
#include <fmt/format.h>

#include <cmath>
#include <memory>

#include <isonest/error.h>

#include "store/files/output_file.h"
#include "tools/cli/command.h"
#include "tools/cli/leftovers.h"
#include "tools/cli/units.h"
#include "tools/drawing/picture.h"
#include "tools/drawing/ply_reader.h"
#include "tools/drawing/png_writer.h"

namespace isonest::detail::cli {
namespace {

struct Arguments {
    std::string mesh;
    std::string png;
    PictureOptions options;
};

Result run(const Arguments& a, Progress& progress) {
    if (!is_png(a.png)) {
        throw Error(ErrorKind::invalid_argument, {a.png}, "a picture's name must end with .png");
    }
    check_output(a.png, true, {a.mesh});
    const PlyMesh mesh(a.mesh);
    const PictureReport r = draw_picture(mesh, a.png, a.options, progress);
    Result result;
    result.json = {{"picture", a.png},
                   {"width", a.options.width},
                   {"height", a.options.height},
                   {"vertices", mesh.vertices()},
                   {"triangles", mesh.triangles()},
                   {"shading", r.smooth ? "smooth" : "flat"},
                   {"lo", r.lo},
                   {"hi", r.hi}};
    result.text = fmt::format("{}: {} x {} pixels, {} triangles\n", a.png, a.options.width,
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
    const auto a = std::make_shared<Arguments>();
    CLI::App* const c =
        add_command(app, chosen, "picture",
                    {"Draw a mesh as a PNG",
                     "MESH is a binary PLY file of triangles. Shaded, off screen, fitted into the "
                     "picture, z up;\n"
                     "the side toward larger values is drawn in a paler, warmer colour.",
                     "isonest picture surface.ply -o surface.png\n"
                     "isonest picture surface.ply -o edges.png --wireframe --size 1600x1200\n"
                     "isonest picture surface.ply -o top.png --view 0,0,1 --color 200,120,90"});
    PictureOptions& o = a->options;
    c->add_option("MESH", a->mesh, "a PLY file, for example from isonest extract")->required();
    c->add_option("-o,--output", a->png, "the picture to write")->required()->type_name("OUT.png");
    add_parsed(
        c, "--size",
        [&o](const std::string& text) {
            const std::vector<int> size = parse_size("--size", text, kMostPixels);
            o.width = size[0];
            o.height = size[1];
        },
        "pixels [800x600]", "WxH");
    add_parsed(
        c, "--view",
        [&o](const std::string& text) {
            o.view = parse_double3("--view", text);
            if (std::hypot(o.view[0], o.view[1], o.view[2]) == 0) {
                throw Error(ErrorKind::invalid_argument,
                            fmt::format("--view '{}': give a direction, not zero", text));
            }
        },
        "direction from the mesh toward the eye [1,-1.6,0.9]", "X,Y,Z");
    c->add_flag("--wireframe", o.wireframe, "draw the edges of the triangles too");
    c->add_flag("--flat", o.flat, "one shade per triangle");
    add_parsed(
        c, "--color",
        [&o](const std::string& text) {
            const std::vector<double> rgb = parse_numbers("--color", text, 3, "R,G,B");
            for (std::size_t i = 0; i < 3; ++i) {
                if (rgb[i] < 0 || rgb[i] > 255) {
                    throw Error(ErrorKind::invalid_argument,
                                fmt::format("--color '{}': give numbers from 0 to 255", text));
                }
                o.color.at(i) = static_cast<int>(rgb[i]);
            }
        },
        "of the surface, each 0 to 255 [86,140,196]", "R,G,B");
    add_memory(c, o.memory);
    c->callback(
        [a, &chosen] { chosen.run = [a](Progress& progress) { return run(*a, progress); }; });
}

}  // namespace isonest::detail::cli
