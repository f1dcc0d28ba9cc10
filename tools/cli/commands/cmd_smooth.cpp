// isonest smooth: nonlinear diffusion on adaptive grids (section 7 of the paper).
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <set>

#include <isonest/error.h>

#include "query/finite_elements/nonlinear_diffusion.h"
#include "store/base/memory_budget.h"
#include "store/remote/open_location.h"
#include "tools/cli/command.h"
#include "tools/cli/commands/smooth_outputs.h"
#include "tools/cli/commands/volume_values.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/source_options.h"
#include "tools/cli/options/units.h"
#include "tools/cli/terminal/leftovers.h"

namespace isonest::detail::cli {
namespace {

struct SmoothArguments {
    std::string input;
    SourceOptions source;
    DiffusionOptions diffusion;
    std::optional<double> sigma;
    int steps = 0;
    std::set<int> snapshots;
    std::string output;
    std::string grid;
    std::string colors = "viridis";
    std::vector<int> size{800, 800};
    std::uint64_t memory = std::uint64_t{1} << 30U;
    bool force = false;
    std::string source_option;   ///< one that says how a volume file is read, or empty
    std::string picture_option;  ///< one that is of pictures, or empty
    RemoteArguments remote;
};

/// A store, or a volume file.
VolumeValues open_values(SmoothArguments& a, Progress& progress) {
    // NOLINTNEXTLINE(clang-analyzer-deadcode.DeadStores): used where a store was not opened
    const std::uint64_t memory = a.memory;
    std::shared_ptr<const Store> store;
    try {
        store = std::make_shared<const Store>(open_store(a.input, a.remote, a.memory, progress));
    } catch (const Error& error) {
        if (!is_no_store(error) && !may_be_folder(error, a.input)) {
            throw;
        }
    }
    if (store) {
        require_no_source_option(a.source_option, store->path().string());
        return VolumeValues(std::move(store));
    }
    if (a.source.missing) {
        throw Error(ErrorKind::invalid_argument,
                    "--missing: all values of a volume that is smoothed have to be numbers");
    }
    a.memory = memory;
    a.remote.opened = 0;
    reach_volume({a.input}, a.remote, a.memory, a.source, progress);
    return {open_volume(a.input, a.source), shown_location(a.input)};
}

/// The names that will be written, before any work.
std::vector<std::filesystem::path> names_of(const SmoothArguments& a) {
    std::vector<std::filesystem::path> names;
    for (const std::string& name : {a.output, a.grid}) {
        if (!name.empty()) {
            names.emplace_back(name);
            for (const int step : a.snapshots) {
                names.push_back(name_of_step(name, step));
            }
        }
    }
    return names;
}

/// Stops when the user's does, and shows nothing: the steps are what is counted.
class WithinStep : public Progress {
  public:
    explicit WithinStep(const Progress& whole) : whole_(whole) {}
    [[nodiscard]] bool cancelled() const override { return whole_.cancelled(); }

  private:
    const Progress& whole_;
};

/// The steps, and what is written on the way.
class Run {
  public:
    Run(const SmoothArguments& a, SmoothedPlace place, std::vector<float> values)
        : a_(a),
          place_(std::move(place)),
          diffusion_(place_.lattice, place_.spacing, std::move(values), a.diffusion) {}

    Json steps(Progress& progress) {
        Json reports = Json::array();
        progress.begin("smooth", static_cast<std::uint64_t>(a_.steps), "steps");
        WithinStep within(progress);
        for (int step = 0;; ++step) {
            if (a_.snapshots.count(step) != 0) {
                write(name_of_step(a_.output, step),
                      a_.grid.empty() ? "" : name_of_step(a_.grid, step));
            }
            if (step == a_.steps) {
                break;
            }
            last_ = diffusion_.step(within);
            progress.advance(1);
            reports.push_back({{"step", step + 1},
                               {"unknowns", last_.unknowns},
                               {"iterations", last_.iterations},
                               {"residual", last_.residual},
                               {"mean", last_.mean},
                               {"variance", last_.variance},
                               {"least", last_.least},
                               {"largest", last_.largest}});
        }
        write(a_.output, a_.grid);
        return reports;
    }
    [[nodiscard]] const DiffusionStep& last() const { return last_; }

  private:
    void write(const std::filesystem::path& output, const std::filesystem::path& grid) {
        write_values(output, place_, diffusion_.values());
        if (!grid.empty()) {
            write_grid(grid, place_, diffusion_.grid(silent_progress()), diffusion_.values());
        }
    }

    const SmoothArguments& a_;
    SmoothedPlace place_;
    NonlinearDiffusion diffusion_;
    DiffusionStep last_;
};

Result run(SmoothArguments& a, Progress& progress) {
    if (!a.snapshots.empty() && *a.snapshots.rbegin() > a.steps) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("--snapshots {}: there are only {} steps", *a.snapshots.rbegin(), a.steps));
    }
    const bool draws = std::filesystem::path(a.output).extension() == ".png" ||
                       std::filesystem::path(a.grid).extension() == ".png";
    if (!a.picture_option.empty() && !draws) {
        throw Error(ErrorKind::invalid_argument,
                    a.picture_option +
                        " goes with a picture: an --output or --grid that ends "
                        "with .png");
    }
    const auto start = std::chrono::steady_clock::now();
    a.source.max_heap = a.memory / 4;
    VolumeValues input = open_values(a, progress);
    a.input = shown_location(a.input);
    const VolumeDescription d = input.describe();
    SmoothedPlace place{Lattice(d.nodes), d.spacing, d.origin,  d.direction, 0,      1,
                        a.colors,         a.size[0], a.size[1], a.force,     d.unit, d.frame};
    if (place.lattice.dimension() == 0) {
        throw Error(ErrorKind::unsupported, {a.input}, "there is only one node");
    }
    for (const std::filesystem::path& name : names_of(a)) {
        check_smoothed(name, place, input.files());
    }
    if (!a.sigma) {
        double nearest = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const double s = d.spacing.at(static_cast<std::size_t>(axis));
            nearest = d.nodes[axis] > 1 && (nearest == 0 || s < nearest) ? s : nearest;
        }
        a.sigma = nearest;
    }
    a.diffusion.sigma = *a.sigma;
    require_memory(
        a.input, a.memory,
        kLibraryHeap + input.heap() + NonlinearDiffusion::heap(place.lattice, a.diffusion),
        "this many unknowns");
    std::vector<float> values = input.read(progress);
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    place.low = static_cast<double>(*low);
    place.high = static_cast<double>(*high);
    Run work(a, std::move(place), std::move(values));
    Result result;
    const Json steps = work.steps(progress);
    const double seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    result.warning = leftovers_of(a.output);
    result.json = {{"output", a.output},
                   {"nodes", {d.nodes.x, d.nodes.y, d.nodes.z}},
                   {"tau", a.diffusion.tau},
                   {"lambda", a.diffusion.lambda},
                   {"sigma", a.diffusion.sigma},
                   {"threshold", a.diffusion.threshold},
                   {"steps", steps},
                   {"seconds", seconds}};
    if (!a.grid.empty()) {
        result.json["grid"] = a.grid;
    }
    const auto nodes = static_cast<double>(d.nodes.product());
    result.text = fmt::format("{}: {} steps in {}", a.output, a.steps, human_seconds(seconds));
    if (a.steps > 0) {
        result.text +=
            fmt::format("; {} of {} nodes in the last ({:.3g} %), values {} with the mean {:.6g}",
                        human_count(static_cast<double>(work.last().unknowns)), human_count(nodes),
                        100 * static_cast<double>(work.last().unknowns) / nodes,
                        human_range(work.last().least, work.last().largest), work.last().mean);
    }
    result.text += '\n';
    if (input.store() != nullptr) {
        add_fetched(*input.store(), result);
    } else {
        add_fetched(*input.source(), result);
    }
    return result;
}

constexpr int kMostSteps = 1'000'000;

std::set<int> parse_snapshots(const std::string& text) {
    const auto count = static_cast<std::size_t>(std::count(text.begin(), text.end(), ',')) + 1;
    std::set<int> steps;
    for (const double v : parse_numbers("--snapshots", text, count, "N,N,...")) {
        if (!(v >= 0) || v > kMostSteps || v != std::floor(v)) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("--snapshots '{}': give numbers of steps, 0 or more", text));
        }
        steps.insert(static_cast<int>(v));
    }
    return steps;
}

double parse_at_least(const char* option, const std::string& text, bool zero) {
    const double v = parse_number(option, text);
    if (!(zero ? v >= 0 : v > 0)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} '{}': give a number {} 0", option, text, zero ? ">=" : ">"));
    }
    return v;
}

}  // namespace

void add_smooth(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<SmoothArguments>();
    CLI::App* const c = add_command(
        app, chosen, "smooth",
        {"Smooth a volume or an image and keep its edges, on adaptive grids",
         "Nonlinear diffusion (Perona and Malik) by linear finite elements: where the gradient is\n"
         "well above --lambda little flows. Each step takes the grid of the nodes at which the\n"
         "indicator grad_linf_bar is --threshold or more. All unknowns are held in memory.",
         "isonest smooth scan.nrrd --steps 10 --tau 1 --lambda 20 -o smooth.nrrd\n"
         "isonest smooth map.raw --dims 2401,1201 --type float32 --steps 20 --tau 1 --lambda 5 \\\n"
         "    --threshold 1 --snapshots 0,5,10 --grid grid.png -o map.png"});
    c->add_option("INPUT", a->input, "a volume that preprocess reads, or a store, a file or a URL")
        ->required();
    add_source_options(c, a->source, false);
    add_parsed(
        c, "--steps",
        [a](const std::string& text) {
            a->steps = static_cast<int>(parse_integer("--steps", text, 0, kMostSteps));
        },
        "how many", "N")
        ->required();
    add_parsed(
        c, "--tau",
        [a](const std::string& text) { a->diffusion.tau = parse_at_least("--tau", text, false); },
        "time of a step, in squares of world units: without edges, N steps smooth as a\n"
        "Gaussian of standard deviation sqrt(2 N T) does",
        "T")
        ->required();
    add_parsed(
        c, "--lambda",
        [a](const std::string& text) {
            a->diffusion.lambda = parse_at_least("--lambda", text, false);
        },
        "the gradient at which half flows, in values per world unit", "L")
        ->required();
    add_parsed(
        c, "--sigma",
        [a](const std::string& text) { a->sigma = parse_at_least("--sigma", text, true); },
        "the gradient is that of the function smoothed by this Gaussian, in world units;\n"
        "0 = not smoothed [the smallest spacing]",
        "S");
    add_parsed(
        c, "--threshold",
        [a](const std::string& text) {
            a->diffusion.threshold = parse_at_least("--threshold", text, true);
        },
        "nodes are left out where grad_linf_bar is below, in values per world unit;\n"
        "0 = all nodes [0]",
        "E");
    add_parsed(
        c, "--snapshots", [a](const std::string& text) { a->snapshots = parse_snapshots(text); },
        "write these steps too, as OUT-N", "N,N,...");
    c->add_option("--grid", a->grid,
                  "the grid of the result: 1 at its nodes, 0 elsewhere (uint8), or, in a plane,\n"
                  "a .png of its triangles")
        ->type_name("FILE");
    c->add_option("--colors", a->colors, "of a picture [viridis]")->type_name("NAME");
    add_parsed(
        c, "--size",
        [a](const std::string& text) {
            constexpr int kMost = 4096;
            a->size = parse_size("--size", text, kMost);
        },
        "of a picture, pixels [800x800]", "WxH");
    c->add_option("-o,--output", a->output,
                  "the file to write: .h5, .nrrd, .raw (float32), in a plane also .png")
        ->required()
        ->type_name("OUT");
    c->add_flag("--force", a->force, "replace existing files");
    add_memory(c, a->memory);
    add_threads(c, a->diffusion.threads);
    add_remote_options(c, a->remote);
    c->callback([a, c, &chosen] {
        a->source_option = given_source_option(*c);
        for (const char* const option : {"--colors", "--size"}) {
            if (c->get_option(option)->count() > 0) {
                a->picture_option = option;
            }
        }
        chosen.run = [a](Progress& progress) {
            require_far(a->remote, {a->input});
            return run_beside_fetching(a->remote, [&] { return run(*a, progress); });
        };
    });
}

}  // namespace isonest::detail::cli
