// isonest smooth: nonlinear diffusion on adaptive grids (section 7 of the paper).

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/frame.h>
#include <isonest/int3.h>
#include <isonest/length_unit.h>
#include <isonest/progress.h>
#include <isonest/smooth.h>

#include "query/finite_elements/active_nodes.h"
#include "query/finite_elements/grid_elements.h"
#include "query/finite_elements/nonlinear_diffusion.h"
#include "query/finite_elements/volume_values.h"
#include "store/base/memory.h"
#include "store/base/vectors.h"
#include "store/container/format.h"
#include "store/exports/volume_file.h"
#include "store/files/output_file.h"
#include "store/lattice/lattice.h"
#include "store/remote/open_location.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/source_options.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"
#include "tools/cli/terminal/interrupt.h"
#include "tools/drawing/canvas.h"
#include "tools/drawing/slice_picture.h"

namespace isonest::detail::cli {

// The output of isonest smooth: functions and grids, as volume files or pictures.

/// Placement of a lattice in the world, and options for drawing it.
struct SmoothedPlace {
    Lattice lattice;
    Double3 spacing{1, 1, 1};
    Double3 origin{0, 0, 0};
    Directions direction = kAlongWorld;
    double low = 0;   ///< value at the low end of the colour map
    double high = 1;  ///< value at the high end
    std::string colors = "viridis";
    int width = 800;  ///< width of a picture in pixels
    int height = 800;
    bool force = false;
    std::optional<LengthUnit> unit = {};
    AnatomicalFrame frame = AnatomicalFrame::unknown;
};

/// "dir/name-30.nrrd" for step 30 of "dir/name.nrrd".
std::filesystem::path name_of_step(const std::filesystem::path& path, int step);

/// Writes the values of all nodes as .h5, .nrrd, .raw (float32) or, for data in a plane, .png.
/// Throws Error{io, invalid_argument}.
void write_values(const std::filesystem::path& path, const SmoothedPlace& place,
                  std::span<const float> values);

/// Writes a grid as .h5, .nrrd, .raw (uint8: 1 at active nodes, else 0) or, for data in a plane, as
/// a .png that shows its triangles and these values. Throws Error{io, invalid_argument}.
void write_grid(const std::filesystem::path& path, const SmoothedPlace& place, const NodeSet& grid,
                std::span<const float> values);

/// Checks in advance that these files can be written. Throws Error{invalid_argument, not_found,
/// io}.
void check_smoothed(const std::filesystem::path& path, const SmoothedPlace& place,
                    const std::vector<std::filesystem::path>& inputs);

namespace {

/// Sends rows of elements or vertices to a sink in batches.
template <class Row>
class Batch {
  public:
    explicit Batch(std::function<void(std::uint64_t first, std::span<const Row>)> send)
        : send_(std::move(send)) {}
    void add(const Row& row) {
        rows_.push_back(row);
        if (rows_.size() == MeshSink::kMaxRows) {
            flush();
        }
    }
    void flush() {
        send_(first_, rows_);
        first_ += rows_.size();
        rows_.clear();
    }

  private:
    std::function<void(std::uint64_t, std::span<const Row>)> send_;
    std::uint64_t first_ = 0;
    std::vector<Row> rows_;
};

/// A grid in a plane as a mesh with the vertex attribute "value".
class PlaneMesh {
  public:
    PlaneMesh(const SmoothedPlace& place, const NodeSet& grid, std::span<const float> values)
        : place_(place), grid_(grid), values_(values) {}

    void send(MeshSink& sink) const {
        MeshLayout layout;
        layout.vertices = grid_.count();
        layout.attributes = {{"value", 1, false, 0}};
        layout.row_bytes = sizeof(float);
        layout.unit = place_.unit;
        layout.frame = place_.frame;
        const Int3 last = grid_.nodes() - Int3{1, 1, 1};
        layout.lo = position({0, 0, 0});
        layout.hi = position(last);
        for_leaves([&](const NumberedElement<2>&) { ++layout.elements; });
        sink.prepare(layout, {});
        sink.begin(layout);
        do {
            send_vertices(sink);
            send_elements(sink);
        } while (sink.again());
        sink.end();
    }

  private:
    struct Vertex {
        std::array<float, 3> position;
        float value;
    };
    [[nodiscard]] std::array<float, 3> position(const Int3& p) const {
        Double3 shift{};
        for (std::size_t a = 0; a < 3; ++a) {
            shift.at(a) = place_.spacing.at(a) * static_cast<double>(p[static_cast<int>(a)]);
        }
        shift = rotated(place_.direction, shift);
        std::array<float, 3> out{};
        for (std::size_t a = 0; a < 3; ++a) {
            out.at(a) = static_cast<float>(place_.origin.at(a) + shift.at(a));
        }
        return out;
    }
    [[nodiscard]] Vertex vertex(const Int3& p) const {
        return {position(p), values_[static_cast<std::size_t>(grid_.nodes().linear(p))]};
    }
    template <class Action>
    void for_leaves(const Action& action) const {
        LatticeNumbering numbering(grid_.nodes());
        const ActiveNumbers active(grid_);
        for_each_element<2>(
            place_.lattice, WithinVolume{grid_.nodes() - Int3{1, 1, 1}},
            [&](const Element<2>& t) { return active.indicator(t.ref_node(), Field::values) != 0; },
            numbering, action);
    }
    static void split(std::span<const Vertex> rows, std::vector<std::array<float, 3>>& positions,
                      std::vector<std::byte>& attributes) {
        positions.clear();
        attributes.resize(rows.size() * sizeof(float));
        for (std::size_t i = 0; i < rows.size(); ++i) {
            positions.push_back(rows[i].position);
            std::memcpy(attributes.data() + i * sizeof(float), &rows[i].value, sizeof(float));
        }
    }
    void send_vertices(MeshSink& sink) const {
        std::vector<std::array<float, 3>> positions;
        std::vector<std::byte> attributes;
        Batch<Vertex> batch([&](std::uint64_t first, std::span<const Vertex> rows) {
            split(rows, positions, attributes);
            sink.add_vertices({first, positions, attributes, sizeof(float)});
        });
        const Int3 nodes = grid_.nodes();
        for (std::int64_t row = 0; row < nodes.y * nodes.z; ++row) {
            const Int3 p{0, row % nodes.y, row / nodes.y};
            grid_.for_row(p, nodes.x, [&](std::int64_t x, std::uint64_t) {
                batch.add(vertex({x, p.y, p.z}));
            });
        }
        batch.flush();
    }
    void send_elements(MeshSink& sink) const {
        std::vector<std::array<float, 3>> positions;
        std::vector<std::byte> attributes;
        std::vector<Vertex> corners;
        std::vector<std::array<std::uint32_t, 3>> nearby;
        Batch<std::array<Int3, 3>> batch([&](std::uint64_t first,
                                             std::span<const std::array<Int3, 3>> rows) {
            std::vector<std::array<std::uint64_t, 3>> numbers;
            corners.clear();
            nearby.clear();
            for (const auto& t : rows) {
                auto& n = numbers.emplace_back();
                auto& c = nearby.emplace_back();
                for (std::size_t i = 0; i < 3; ++i) {
                    n.at(i) = grid_.number(t.at(i));
                    c.at(i) = static_cast<std::uint32_t>(corners.size());
                    corners.push_back(vertex(t.at(i)));
                }
            }
            split(corners, positions, attributes);
            sink.add_elements({first, numbers, nearby, {0, positions, attributes, sizeof(float)}});
        });
        for_leaves([&](const NumberedElement<2>& t) { batch.add(t.simplex.v); });
        batch.flush();
    }

    const SmoothedPlace& place_;
    const NodeSet& grid_;
    std::span<const float> values_;
};

/// Draws the triangles of the grid, optionally with their edges.
void draw(const std::filesystem::path& path, const SmoothedPlace& place, const NodeSet& grid,
          std::span<const float> values, bool edges) {
    SlicePictureOptions options;
    for (std::size_t a = 0; a < 3; ++a) {
        options.normal.at(a) = (place.lattice.flat_axes() >> a & 1U) != 0 ? 1 : 0;
    }
    options.low = place.low;
    options.high = place.high > place.low ? place.high : place.low + 1;
    options.colors = place.colors;
    options.width = place.width;
    options.height = place.height;
    options.grid = edges;
    SlicePicture picture(path, options);
    PlaneMesh(place, grid, values).send(picture);
}

NodeSet all_nodes(const Lattice& lattice) {
    NodeSet all(lattice.nodes());
    for (std::int64_t i = 0; i < lattice.nodes().product(); ++i) {
        all.insert(lattice.nodes().unlinear(i));
    }
    all.finish();
    return all;
}

VolumeFileSpec spec_of(const SmoothedPlace& place, ValueType type) {
    return {place.lattice.nodes(), type,        place.spacing, place.origin,
            place.direction,       place.force, place.unit,    place.frame};
}

}  // namespace

std::filesystem::path name_of_step(const std::filesystem::path& path, int step) {
    return path.parent_path() /
           fmt::format("{}-{}{}", path.stem().string(), step, path.extension().string());
}

void write_values(const std::filesystem::path& path, const SmoothedPlace& place,
                  std::span<const float> values) {
    if (is_png(path)) {
        return draw(path, place, all_nodes(place.lattice), values, false);
    }
    const auto file = create_volume_file(path, spec_of(place, ValueType::f32));
    file->write(reinterpret_cast<const std::byte*>(values.data()), place.lattice.nodes().z);
    file->finish();
}

void write_grid(const std::filesystem::path& path, const SmoothedPlace& place, const NodeSet& grid,
                std::span<const float> values) {
    if (is_png(path)) {
        return draw(path, place, grid, values, true);
    }
    const Int3 nodes = grid.nodes();
    const auto file = create_volume_file(path, spec_of(place, ValueType::u8));
    std::vector<std::uint8_t> plane(static_cast<std::size_t>(nodes.x * nodes.y));
    for (std::int64_t z = 0; z < nodes.z; ++z) {
        std::fill(plane.begin(), plane.end(), std::uint8_t{0});
        for (std::int64_t y = 0; y < nodes.y; ++y) {
            grid.for_row({0, y, z}, nodes.x, [&](std::int64_t x, std::uint64_t) {
                plane[static_cast<std::size_t>(x + nodes.x * y)] = 1;
            });
        }
        file->write(reinterpret_cast<const std::byte*>(plane.data()), 1);
    }
    file->finish();
}

void check_smoothed(const std::filesystem::path& path, const SmoothedPlace& place,
                    const std::vector<std::filesystem::path>& inputs) {
    const std::string ending = lower_extension(path);
    const bool plane = place.lattice.dimension() == 2;
    if (ending == ".png" && !plane) {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    "pictures need data in a plane, and this is a volume",
                    {{RemedyKind::other_format, ".h5, .nrrd, .raw"}});
    }
    if (ending != ".png" && ending != ".h5" && ending != ".hdf5" && ending != ".nrrd" &&
        ending != ".raw") {
        throw Error(
            ErrorKind::invalid_argument, {path.string()}, "unknown ending",
            {{RemedyKind::other_format, plane ? ".h5, .nrrd, .raw, .png" : ".h5, .nrrd, .raw"}});
    }
    check_output(path, place.force, inputs);
}

namespace {

struct SmoothArguments {
    std::string input;
    SourceOptions source;
    SmoothOptions smooth;
    int steps = 0;
    std::set<int> snapshots;
    std::string output;
    std::string grid;
    std::string colors = "viridis";
    std::vector<int> size{800, 800};
    bool force = false;
    std::string source_option;   ///< an option given for reading a volume file, or empty
    std::string picture_option;  ///< an option given for the picture, or empty
    RemoteArguments remote;
};

/// A store or a volume file.
struct Input {
    std::unique_ptr<const Store> store;
    std::unique_ptr<VolumeSource> source;

    [[nodiscard]] VolumeDescription describe() const {
        return store ? VolumeValues(store->reader()).describe() : source->describe();
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const {
        return store ? std::vector{store->path()} : source->files();
    }
    [[nodiscard]] Smoothing smoothing(const SmoothOptions& options, Progress& progress) const {
        return store ? Smoothing(*store, options, progress) : Smoothing(*source, options, progress);
    }
};

Input open_values(SmoothArguments& a, Progress& progress) {
    // NOLINTNEXTLINE(clang-analyzer-deadcode.DeadStores): used where a store was not opened
    const std::uint64_t memory = a.smooth.memory;
    std::unique_ptr<const Store> store;
    try {
        store =
            std::make_unique<const Store>(open_store(a.input, a.remote, a.smooth.memory, progress));
    } catch (const Error& error) {
        if (!is_no_store(error) && !may_be_folder(error, a.input)) {
            throw;
        }
    }
    if (store) {
        require_no_source_option(a.source_option, store->path().string());
        return {std::move(store), nullptr};
    }
    if (a.source.missing) {
        throw Error(ErrorKind::invalid_argument,
                    "--missing: smoothing does not support missing values");
    }
    a.smooth.memory = memory;
    a.remote.opened = 0;
    reach_volume({a.input}, a.remote, a.smooth.memory, a.source, progress);
    return {nullptr, open_volume(a.input, a.source)};
}

/// The files that will be written.
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

/// Progress of one step: can be cancelled like the whole run, but displays nothing, because
/// progress counts whole steps.
class WithinStep : public Progress {
  public:
    explicit WithinStep(const Progress& whole) : whole_(whole) {}
    [[nodiscard]] bool cancelled() const override { return whole_.cancelled(); }

  private:
    const Progress& whole_;
};

/// Runs the steps and writes the output.
class Run {
  public:
    Run(const SmoothArguments& a, SmoothedPlace place, Smoothing smoothing)
        : a_(a), place_(std::move(place)), smoothing_(std::move(smoothing)) {
        const auto [low, high] =
            std::minmax_element(smoothing_.values().begin(), smoothing_.values().end());
        place_.low = static_cast<double>(*low);
        place_.high = static_cast<double>(*high);
    }

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
            last_ = smoothing_.step(within);
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
    [[nodiscard]] const SmoothStep& last() const { return last_; }
    [[nodiscard]] const SmoothOptions& options() const { return smoothing_.options(); }

  private:
    void write(const std::filesystem::path& output, const std::filesystem::path& grid) {
        write_values(output, place_, smoothing_.values());
        if (!grid.empty()) {
            write_grid(grid, place_, smoothing_.diffusion().grid(silent_progress()),
                       smoothing_.values());
        }
    }

    const SmoothArguments& a_;
    SmoothedPlace place_;
    Smoothing smoothing_;
    SmoothStep last_;
};

Result run(SmoothArguments& a, Progress& progress) {
    if (!a.snapshots.empty() && *a.snapshots.rbegin() > a.steps) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("--snapshots {}: there are only {} steps", *a.snapshots.rbegin(), a.steps));
    }
    const bool draws = is_png(a.output) || is_png(a.grid);
    if (!a.picture_option.empty() && !draws) {
        throw Error(
            ErrorKind::invalid_argument,
            a.picture_option + " needs a picture: give an --output or --grid that ends with .png");
    }
    const auto start = std::chrono::steady_clock::now();
    a.source.max_heap = a.smooth.memory / 4;
    const Input input = open_values(a, progress);
    a.input = shown_location(a.input);
    const VolumeDescription d = input.describe();
    require_right_angles(d.direction, a.input, "smoothing");
    SmoothedPlace place{Lattice(d.nodes), d.spacing, d.origin,  d.direction, 0,      1,
                        a.colors,         a.size[0], a.size[1], a.force,     d.unit, d.frame};
    if (place.lattice.dimension() == 0) {
        throw Error(ErrorKind::unsupported, {a.input}, "there is only one node");
    }
    for (const std::filesystem::path& name : names_of(a)) {
        check_smoothed(name, place, input.files());
    }
    Run work(a, std::move(place), input.smoothing(a.smooth, progress));
    Result result;
    const Json steps = work.steps(progress);
    const double seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    result.warning = leftovers_of(a.output);
    result.json = {{"output", a.output},
                   {"nodes", {d.nodes.x, d.nodes.y, d.nodes.z}},
                   {"tau", a.smooth.tau},
                   {"lambda", a.smooth.lambda},
                   {"sigma", *work.options().sigma},
                   {"threshold", a.smooth.threshold},
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
    if (input.store) {
        add_fetched(*input.store, result);
    } else {
        add_fetched(*input.source, result);
    }
    return result;
}

constexpr int kMaxSteps = 1'000'000;

std::set<int> parse_snapshots(const std::string& text) {
    const auto count = static_cast<std::size_t>(std::count(text.begin(), text.end(), ',')) + 1;
    std::set<int> steps;
    for (const double v : parse_numbers("--snapshots", text, count, "N,N,...")) {
        if (!(v >= 0) || v > kMaxSteps || v != std::floor(v)) {
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
        {"Smooth a volume or an image while preserving edges, on adaptive grids",
         "Nonlinear diffusion (Perona and Malik) by linear finite elements: diffusion is weak "
         "where the gradient is well above --lambda. Without edges, N steps of --tau T smooth like "
         "a Gaussian with standard deviation sqrt(2 N T). Each step uses the grid of the nodes "
         "whose indicator grad_linf_bar is at least --threshold. All unknowns are kept in memory.",
         "isonest smooth scan.nrrd --steps 10 --tau 1 --lambda 20 -o smooth.nrrd\n"
         "isonest smooth map.npy --steps 20 --tau 1 --lambda 5 --threshold 1 -o map.png"});
    c->add_option("INPUT", a->input)->required();
    add_source_options(c, a->source, false);
    add_parsed(c, "--steps", [a](const std::string& text) {
        a->steps = static_cast<int>(parse_integer("--steps", text, 0, kMaxSteps));
    })->required();
    add_parsed(c, "--tau", [a](const std::string& text) {
        a->smooth.tau = parse_at_least("--tau", text, false);
    })->required();
    add_parsed(c, "--lambda", [a](const std::string& text) {
        a->smooth.lambda = parse_at_least("--lambda", text, false);
    })->required();
    add_parsed(c, "--sigma", [a](const std::string& text) {
        a->smooth.sigma = parse_at_least("--sigma", text, true);
    });
    add_parsed(c, "--threshold", [a](const std::string& text) {
        a->smooth.threshold = parse_at_least("--threshold", text, true);
    });
    add_parsed(c, "--snapshots",
               [a](const std::string& text) { a->snapshots = parse_snapshots(text); });
    c->add_option("--grid", a->grid);
    c->add_option("--colors", a->colors);
    add_parsed(
        c, "--size",
        [a](const std::string& text) {
            constexpr int kMax = 4096;
            a->size = parse_size("--size", text, kMax);
        },
        "800x800");
    c->add_option("-o,--output", a->output)->required();
    c->add_flag("--force", a->force);
    add_memory(c, a->smooth.memory);
    add_threads(c, a->smooth.threads);
    add_remote_options(c, a->remote);
    c->callback([a, c, &chosen] {
        a->source_option = given_source_option(*c);
        for (const char* const option : {"--colors", "--size"}) {
            if (c->get_option(option)->count() > 0) {
                a->picture_option = option;
            }
        }
        chosen.run = [a](Progress& progress) {
            return run_beside_fetching(a->remote, {a->input}, [&] { return run(*a, progress); });
        };
    });
}

}  // namespace isonest::detail::cli
