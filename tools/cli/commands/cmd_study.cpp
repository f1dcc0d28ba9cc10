// isonest study: compares the indicators of one store in a table and plots.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <memory>
#include <span>
#include <vector>

#include <isonest/error.h>
#include <isonest/study.h>

#include "store/files/output_file.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"
#include "tools/cli/terminal/interrupt.h"
#include "tools/drawing/plot.h"

namespace isonest::detail::cli {
namespace {

struct StudyArguments {
    std::string store;
    std::string folder;
    StudyOptions study;
    RemoteArguments remote;
};

using Value = double (*)(const StudyRow&);
struct Column {
    const char* name;   ///< of the column in the CSV file, and of the plot's file
    const char* title;  ///< of the plot
    const char* axis;
    Value of;
};
constexpr std::array<Column, 11> kColumns{
    {{"visited", "Elements visited", "visited cells, all levels",
      [](const StudyRow& r) { return static_cast<double>(r.visited); }},
     {"leaves", "Elements of the adaptive grid", "elements",
      [](const StudyRow& r) { return static_cast<double>(r.leaves); }},
     {"l1", "Error of the function in the L1 norm", "||P U - U||, L1",
      [](const StudyRow& r) { return r.norms.l1; }},
     {"l2", "Error of the function in the L2 norm", "||P U - U||, L2",
      [](const StudyRow& r) { return r.norms.l2; }},
     {"linf", "Largest error of the function", "||P U - U||, L infinity",
      [](const StudyRow& r) { return r.norms.linf; }},
     {"efficiency_l1", "Efficiency E, L1 norm", "1 / (visited error), L1",
      [](const StudyRow& r) { return r.efficiency(r.norms.l1); }},
     {"efficiency_l2", "Efficiency E, L2 norm", "1 / (visited error), L2",
      [](const StudyRow& r) { return r.efficiency(r.norms.l2); }},
     {"efficiency_linf", "Efficiency E, maximum norm", "1 / (visited error), L infinity",
      [](const StudyRow& r) { return r.efficiency(r.norms.linf); }},
     {"element_efficiency_l1", "Accuracy for each element, L1 norm", "1 / (elements error), L1",
      [](const StudyRow& r) { return r.element_efficiency(r.norms.l1); }},
     {"element_efficiency_l2", "Accuracy for each element, L2 norm", "1 / (elements error), L2",
      [](const StudyRow& r) { return r.element_efficiency(r.norms.l2); }},
     {"element_efficiency_linf", "Accuracy for each element, maximum norm",
      "1 / (elements error), L infinity",
      [](const StudyRow& r) { return r.element_efficiency(r.norms.linf); }}}};
constexpr std::array<Column, 3> kIsoColumns{
    {{"iso_visited", "Elements visited for the isosurface", "elements visited for the isosurface",
      [](const StudyRow& r) { return static_cast<double>(r.iso_visited); }},
     {"iso_leaves", "Elements that contain the isosurface", "elements that contain the isosurface",
      [](const StudyRow& r) { return static_cast<double>(r.iso_leaves); }},
     {"iso_efficiency_l2", "Efficiency E for the isosurface, L2 norm",
      "1 / (visited for the isosurface, error), L2",
      [](const StudyRow& r) { return r.iso_efficiency(r.norms.l2); }}}};

constexpr std::array<Column, 3> kTrueColumns{
    {{"value_lp", "Error of the function in L^p, integrated", "||P U - U|| in L^p, integrated",
      [](const StudyRow& r) { return r.true_norms.value; }},
     {"gradient_lp", "Relative error of the gradient in L^p",
      "||grad P U - grad U|| / ||grad U|| in L^p",
      [](const StudyRow& r) { return r.true_norms.gradient; }},
     {"gradient_linf", "Largest relative error of the gradient",
      "||grad P U - grad U|| / ||grad U||, L infinity",
      [](const StudyRow& r) { return r.true_norms.gradient_linf; }}}};
constexpr Column kGraphColumn{"graph_distance", "Distance of the graphs", "distance of the graphs",
                              [](const StudyRow& r) { return r.graph_distance; }};

constexpr Column kNodeColumn{"nodes", "Nodes of the adaptive grid", "nodes",
                             [](const StudyRow& r) { return static_cast<double>(r.nodes); }};

/// Columns that depend on the options, in addition to kColumns.
std::vector<const Column*> further_columns(const StudyOptions& options) {
    std::vector<const Column*> columns;
    const auto add = [&](bool wanted, std::span<const Column> group) {
        for (const Column& column : group) {
            if (wanted) {
                columns.push_back(&column);
            }
        }
    };
    add(!options.plane, {&kNodeColumn, 1});
    add(options.iso.has_value(), kIsoColumns);
    add(options.power.has_value(), kTrueColumns);
    add(options.graphs, {&kGraphColumn, 1});
    return columns;
}

void write_csv(const std::filesystem::path& path, const Study& study,
               const std::vector<const Column*>& further) {
    std::string text = "field,threshold";
    const auto columns = [&](auto&& f) {
        std::for_each(kColumns.begin(), kColumns.end(), f);
        for (const Column* column : further) {
            f(*column);
        }
    };
    columns([&](const Column& c) { text += fmt::format(",{}", c.name); });
    text += '\n';
    for (const StudyRow& row : study.rows) {
        text += fmt::format("{},{:.6g}", name_of(row.field), row.threshold);
        columns([&](const Column& c) { text += fmt::format(",{:.10g}", c.of(row)); });
        text += '\n';
    }
    OutputFile file(path, true);
    file.write_at(0, std::as_bytes(std::span(text)));
    file.publish_as_named();
}

/// A plot, written as .svg and .png.
struct PlotFile {
    const Column* column;
    const Column* over;  ///< null: the threshold
};

std::vector<PlotFile> plots_of(const std::vector<const Column*>& further) {
    std::vector<PlotFile> plots;
    plots.reserve(kColumns.size());
    for (const Column& column : kColumns) {
        plots.push_back({&column, nullptr});
    }
    const bool nodes = std::find(further.begin(), further.end(), &kNodeColumn) != further.end();
    for (std::size_t i = 2; i < 5; ++i) {
        plots.push_back({&kColumns.at(i), &kColumns.at(1)});
        if (nodes) {
            plots.push_back({&kColumns.at(i), &kNodeColumn});
        }
    }
    for (const Column* column : further) {
        plots.push_back({column, nullptr});
    }
    return plots;
}

constexpr const char* kTable = "study.csv";

std::array<std::string, 2> names_of(const PlotFile& plot) {
    const std::string name = plot.over != nullptr
                                 ? fmt::format("{}_by_{}", plot.column->name, plot.over->name)
                                 : plot.column->name;
    return {name + ".svg", name + ".png"};
}

void draw(const std::filesystem::path& folder, const Study& study, const PlotFile& file) {
    const auto x = [&](const StudyRow& r) {
        return file.over != nullptr ? file.over->of(r) : r.threshold;
    };
    Plot plot;
    plot.x = file.over != nullptr ? file.over->axis : "threshold / largest value";
    plot.title = fmt::format("{}, by {}", file.column->title,
                             file.over != nullptr ? file.over->axis : "the threshold");
    plot.y = file.column->axis;
    for (const StudyRow& row : study.rows) {
        if (plot.series.empty() || plot.series.back().name != name_of(row.field)) {
            plot.series.push_back({name_of(row.field), {}});
        }
        plot.series.back().points.emplace_back(x(row), file.column->of(row));
    }
    for (const std::string& name : names_of(file)) {
        draw_plot(folder / name, plot);
    }
}

/// The output folder. Creates it and its missing parents; the destructor removes those that are
/// still empty.
class Folder {
  public:
    explicit Folder(const std::filesystem::path& path) {
        std::error_code error;
        for (std::filesystem::path p = path; !p.empty() && !std::filesystem::exists(p, error);
             p = p.parent_path()) {
            made_.push_back(p);
        }
        std::filesystem::create_directories(path, error);
        if (error) {
            remove_empty();
            throw Error(ErrorKind::io, {path.string()},
                        fmt::format("cannot make this folder: {}", error.message()));
        }
    }
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;
    ~Folder() { remove_empty(); }

  private:
    void remove_empty() {
        for (const std::filesystem::path& p : made_) {
            ::rmdir(p.c_str());
        }
    }
    std::vector<std::filesystem::path> made_;  ///< innermost first
};

std::vector<AnyField> parse_study_fields(const std::string& text) {
    std::vector<AnyField> fields;
    for (std::size_t begin = 0; begin <= text.size();) {
        const std::size_t end = std::min(text.find(',', begin), text.size());
        const std::string name = text.substr(begin, end - begin);
        if (const auto computed = computed_field_from_name(name)) {
            fields.emplace_back(*computed);
        } else {
            fields.emplace_back(parse_field("--fields", name));
        }
        begin = end + 1;
    }
    return fields;
}

/// note_on_name() for the studied fields, a line each.
std::string notes_on_rows(const Study& study) {
    std::string notes;
    for (const StudyRow& row : study.rows) {
        const std::string note = note_on_name(name_of(row.field));
        if (!note.empty() && notes.find(note) == std::string::npos) {
            notes += note + "\n";
        }
    }
    return notes;
}

Result run(StudyArguments& a, Progress& progress) {
    const Store opened = open_required_store(a.store, a.remote, a.study.memory, progress);
    const std::filesystem::path folder = a.folder;
    const Folder made(folder);
    const std::vector<const Column*> further = further_columns(a.study);
    const std::vector<PlotFile> plots = plots_of(further);
    std::vector<std::filesystem::path> outputs{folder / kTable};
    for (const PlotFile& plot : plots) {
        for (const std::string& name : names_of(plot)) {
            outputs.push_back(folder / name);
        }
    }
    for (const std::filesystem::path& output : outputs) {
        check_output(output, true, {opened.path()});
    }
    const Study s = study(opened, a.study, progress);
    write_csv(folder / kTable, s, further);
    for (const PlotFile& plot : plots) {
        draw(folder, s, plot);
    }
    Result result;
    result.warning = leftovers_of(outputs);
    Json rows = Json::array();
    for (const StudyRow& r : s.rows) {
        Json row = {{"field", name_of(r.field)}, {"threshold", r.threshold},
                    {"visited", r.visited},      {"leaves", r.leaves},
                    {"l1", r.norms.l1},          {"l2", r.norms.l2},
                    {"linf", r.norms.linf},      {"iso_visited", r.iso_visited},
                    {"iso_leaves", r.iso_leaves}};
        for (const Column* column : further) {
            row.emplace(column->name, column->of(r));
        }
        rows.push_back(std::move(row));
    }
    result.json = {{"folder", a.folder},
                   {"all_elements", s.all_elements},
                   {"all_cells", s.all_cells},
                   {"tolerance", opened.rounding().tolerance},
                   {"rows", rows}};
    result.text = fmt::format(
        "{}: study.csv and plots of {} fields at {} thresholds; the finest mesh has {} elements, "
        "the finest grid {} cells\nThe columns efficiency_* are 1 / (visited error); "
        "1 / (elements error), which had these names before, is element_efficiency_*\n",
        a.folder, s.rows.size() / static_cast<std::size_t>(a.study.steps), a.study.steps,
        s.all_elements, s.all_cells);
    result.text += rounding_note(opened);
    if (a.study.fields.empty()) {  // named fields have their note already
        result.text += notes_on_rows(s);
    }
    add_fetched(opened, result);
    return result;
}

}  // namespace

void add_study(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<StudyArguments>();
    CLI::App* const c = add_command(
        app, chosen, "study",
        {"Compare the indicators of a store by their numbers of elements and errors",
         "For each field and for thresholds decreasing from its largest value: the elements of the "
         "adaptive mesh of the volume, the elements visited to find them, the error of the "
         "function on the mesh in three norms, and the efficiency 1 / (visited elements x error), "
         "also for elements instead of visited ones, as study.csv and as plots (.svg, .png). "
         "--fields also accepts the computed fields lp:P_bar, grad_lp:P_bar, deviation_lp:P_bar, "
         "deviation_grad_lp:P_bar (P from 1 to inf), gradient_bar, curvature_bar, "
         "graph_curvature_bar, deviation_graph_bar and, of cells, hex_lp:P_bar and "
         "hex_grad_lp:P_bar, or with _plus. The volume must fit into memory, at 20 bytes per node.",
         "isonest preprocess map.h5 --indicators all -o map.isonest\n"
         "isonest study map.isonest --out map-study\n"
         "isonest study head.isonest --fields linf_bar,normal_bar --iso 120 --out study\n"
         "isonest study head.isonest --plane 0,0,1,40 --out slice-study"});
    c->add_option("STORE", a->store)->required();
    c->add_option("-o,--out", a->folder)->required();
    StudyOptions& s = a->study;
    add_parsed(c, "--fields",
               [&s](const std::string& text) { s.fields = parse_study_fields(text); });
    add_parsed(c, "--iso", [&s](const std::string& text) { s.iso = parse_number("--iso", text); });
    add_parsed(c, "--plane", [&s](const std::string& text) {
        const std::vector<double> v = parse_numbers("--plane", text, 4, "NX,NY,NZ,D");
        s.plane = WorldPlane{{v[0], v[1], v[2]}, v[3]};
    });
    add_parsed(c, "--norm",
               [&s](const std::string& text) { s.power = parse_number("--norm", text); });
    c->add_flag("--graph-distance", s.graphs);
    add_parsed(c, "--steps", [&s](const std::string& text) {
        constexpr int kMax = 1000;
        s.steps = static_cast<int>(parse_integer("--steps", text, 2, kMax));
    });
    add_parsed(c, "--least",
               [&s](const std::string& text) { s.least = parse_number("--least", text); });
    add_memory(c, s.memory);
    add_threads(c, s.threads);
    add_remote_options(c, a->remote);
    c->callback([a, &chosen] {
        chosen.run = [a](Progress& progress) {
            return run_beside_fetching(a->remote, {a->store}, [&] { return run(*a, progress); });
        };
    });
}

}  // namespace isonest::detail::cli
