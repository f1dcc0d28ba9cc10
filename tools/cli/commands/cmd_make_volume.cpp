// isonest make-volume: writes synthetic volumes of any size.
#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <memory>

#include <isonest/error.h>

#include "preprocess/synthetic/synthetic.h"
#include "store/lattice/lattice.h"
#include "tools/cli/options/source_options.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"
#include "tools/cli/terminal/interrupt.h"

namespace isonest::detail::cli {
namespace {

struct MakeVolumeArguments {
    std::string output;
    MakeVolumeOptions options;
};

Int3 parse_nodes(const std::string& text) {
    if (text.find(',') != std::string::npos) {
        const bool plane = std::count(text.begin(), text.end(), ',') == 1;
        return parse_int3("--size", plane ? text + ",1" : text, kMaxNodesPerAxis);
    }
    const std::int64_t n = parse_integer("--size", text, 1, kMaxNodesPerAxis);
    return {n, n, n};
}

Result run(const MakeVolumeArguments& a, Progress& progress) {
    make_volume(a.output, a.options, progress);
    const MakeVolumeOptions& o = a.options;
    Result result;
    result.warning = leftovers_of(a.output);
    result.json = {{"output", a.output},
                   {"name", o.name},
                   {"nodes", {o.nodes.x, o.nodes.y, o.nodes.z}},
                   {"type", name_of(o.type)}};
    result.text = fmt::format("{}: {}, {} x {} x {} {}\n", a.output, o.name, o.nodes.x, o.nodes.y,
                              o.nodes.z, name_of(o.type));
    return result;
}

}  // namespace

void add_make_volume(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<MakeVolumeArguments>();
    MakeVolumeOptions& o = a->options;
    std::string names;
    for (const std::string& name : synthetic_names()) {
        names += (names.empty() ? "" : ", ") + name;
    }
    CLI::App* const c = add_command(
        app, chosen, "make-volume",
        {"Write a synthetic volume for tests and benchmarks", "The file may be larger than memory.",
         "isonest make-volume bucky --size 129 -o bucky.h5\n"
         "isonest make-volume noise --size 200,100,50 --type uint8 --seed 7 -o noise.h5\n"
         "isonest make-volume cahn-hilliard --size 257,257 -o mixture.h5"});
    c->add_option("NAME", o.name, names)->required();
    add_parsed(c, "--size", [&o](const std::string& text) {
        o.nodes = parse_nodes(text);
    })->required();
    add_parsed(c, "--type", [&o](const std::string& text) { o.type = parse_type(text); });
    add_parsed(c, "--seed", [&o](const std::string& text) {
        o.seed = static_cast<std::uint64_t>(
            parse_integer("--seed", text, 0, std::numeric_limits<std::int64_t>::max()));
    });
    add_threads(c, o.threads);
    c->add_option("-o,--output", a->output)->required();
    c->add_flag("--force", o.force);
    c->callback([a, c, &chosen] {
        const bool seeded = c->get_option("--seed")->count() > 0;
        chosen.run = [a, seeded](Progress& progress) {
            if (seeded && a->options.name != "noise" && a->options.name != "cahn-hilliard") {
                throw Error(
                    ErrorKind::invalid_argument,
                    fmt::format("--seed: the volume {} contains nothing random", a->options.name));
            }
            return run(*a, progress);
        };
    });
}

}  // namespace isonest::detail::cli
