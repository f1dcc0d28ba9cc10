// isonest extract: from a store to an isosurface mesh.
#include <fmt/format.h>

#include <memory>

#include "query/extract.h"
#include "store/error.h"
#include "tools/command.h"
#include "tools/leftovers.h"
#include "tools/units.h"

namespace isonest::cli {
namespace {

struct Arguments {
    std::string store;
    std::string mesh;
    ExtractOptions extract;
};

double parse_error(const std::string& option, const std::string& text) {
    const double value = parse_number(option, text);
    if (value < 0) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} '{}': give a number >= 0", option, text));
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

Result run(const Arguments& a, Progress& progress) {
    const StoreReader store(a.store);
    const ExtractReport r = extract(store, a.mesh, a.extract, progress);
    const bool promised = a.extract.guarantee != Guarantee::estimate;
    Result result;
    result.warning = leftovers_of(a.mesh);
    result.json = {{"mesh", a.mesh},
                   {"iso", a.extract.iso},
                   {"vertices", r.vertices},
                   {"triangles", r.triangles},
                   {"tolerance", r.tolerance},
                   {"error_bound", r.error_bound},
                   {"guaranteed", promised},
                   {"visited_tetrahedra", r.visited_tetrahedra},
                   {"leaf_tetrahedra", r.leaf_tetrahedra},
                   {"zero_area_triangles", r.zero_area_triangles},
                   {"chunks_read", r.chunks_read},
                   {"chunks_total", r.chunks_total},
                   {"bytes_read", r.bytes_read},
                   {"peak_cache_bytes", r.peak_cache_bytes},
                   {"bricks", r.bricks},
                   {"seconds", r.seconds}};
    result.text = fmt::format(
        "{}: {} triangles, {} vertices, in {}\n"
        "{} {:.6g} (asked for {:.6g}); read {} of {} chunks, {}\n",
        a.mesh, r.triangles, r.vertices, human_seconds(r.seconds),
        promised ? "error at most" : "estimated error", r.error_bound, r.tolerance, r.chunks_read,
        r.chunks_total, human_bytes(static_cast<double>(r.bytes_read)));
    if (r.triangles == 0) {
        result.text += fmt::format("The surface is empty: the values go from {:.6g} to {:.6g}{}.\n",
                                   store.min_value(), store.max_value(),
                                   a.extract.box ? " in the whole volume" : "");
    }
    if (r.zero_area_triangles > 0) {
        result.text +=
            fmt::format("{} triangles have no area; removing them would open the mesh.\n",
                        r.zero_area_triangles);
    }
    return result;
}

}  // namespace

void add_extract(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<Arguments>();
    CLI::App* const c = add_command(
        app, chosen, "extract",
        {"Write an isosurface of a store as a mesh, with a guaranteed error",
         "The mesh (binary PLY) is crack-free, and nowhere further from the isovalue than the "
         "error\n"
         "says. A larger error gives fewer triangles and reads less; error 0 gives the surface at\n"
         "full resolution.",
         "isonest extract scan.isonest --iso 120 -o full.ply\n"
         "isonest extract scan.isonest --iso 120 --error-relative 0.01 -o coarse.ply\n"
         "isonest extract scan.isonest --iso 120 --error 2 --box 0,0,0,50,50,20 -o corner.ply"});
    ExtractOptions& e = a->extract;
    c->add_option("STORE", a->store, "made by isonest preprocess")->required();
    add_parsed(
        c, "--iso", [&e](const std::string& text) { e.iso = parse_number("--iso", text); },
        "the isovalue", "V")
        ->required();
    CLI::Option* const error = add_parsed(
        c, "--error", [&e](const std::string& text) { e.error = parse_error("--error", text); },
        "largest |value - V| on the surface, in units of the data [0]", "E");
    add_parsed(
        c, "--error-relative",
        [&e](const std::string& text) { e.error_relative = parse_error("--error-relative", text); },
        "the same, as a fraction of the data's range", "R")
        ->excludes(error);
    add_parsed(
        c, "--guarantee", [&e](const std::string& text) { e.guarantee = parse_guarantee(text); },
        "deviation (a bound, tight), plus (a bound, looser) or\n"
        "estimate (no bound, usually close) [deviation]",
        "NAME");
    add_parsed(
        c, "--box", [&e](const std::string& text) { e.box = parse_box(text); },
        "only the surface inside this box, in world units", "x0,y0,z0,x1,y1,z1");
    add_memory(c, e.memory);
    add_threads(c, e.threads);
    c->add_option("-o,--output", a->mesh, "the mesh to write")->required()->type_name("MESH.ply");
    c->callback(
        [a, &chosen] { chosen.run = [a](Progress& progress) { return run(*a, progress); }; });
}

}  // namespace isonest::cli
