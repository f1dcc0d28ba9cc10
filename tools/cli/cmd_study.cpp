// isonest study: the indicators compared on one store, as a table and plots.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include <isonest/error.h>

#include "query/study/study.h"
#include "store/files/output_file.h"
#include "tools/cli/command.h"
#include "tools/cli/extract_options.h"
#include "tools/cli/fields.h"
#include "tools/cli/leftovers.h"
#include "tools/cli/units.h"
#include "tools/drawing/plot.h"

namespace isonest::detail::cli {
namespace {

struct Arguments {
    std::string store;
    std::string folder;
    StudyOptions study;
};

using Value = double (*)(const StudyRow&);
struct Column {
    const char* name;  ///< of the CSV's column and of the plot's file
    const char* axis;
    Value of;
};
constexpr std::array<Column, 11> kColumns{
    {{"visited", "visited cells, all levels",
      [](const StudyRow& r) { return static_cast<double>(r.visited); }},
     {"leaves", "elements", [](const StudyRow& r) { return static_cast<double>(r.leaves); }},
     {"l1", "||P U - U||, L1", [](const StudyRow& r) { return r.l1; }},
     {"l2", "||P U - U||, L2", [](const StudyRow& r) { return r.l2; }},
     {"linf", "||P U - U||, L infinity", [](const StudyRow& r) { return r.linf; }},
     {"efficiency_l1", "1 / (elements error), L1",
      [](const StudyRow& r) { return r.efficiency(r.l1); }},
     {"efficiency_l2", "1 / (elements error), L2",
      [](const StudyRow& r) { return r.efficiency(r.l2); }},
     {"efficiency_linf", "1 / (elements error), L infinity",
      [](const StudyRow& r) { return r.efficiency(r.linf); }},
     {"efficiency_visited_l1", "1 / (visited error), L1",
      [](const StudyRow& r) { return r.efficiency_of_visited(r.l1); }},
     {"efficiency_visited_l2", "1 / (visited error), L2",
      [](const StudyRow& r) { return r.efficiency_of_visited(r.l2); }},
     {"efficiency_visited_linf", "1 / (visited error), L infinity",
      [](const StudyRow& r) { return r.efficiency_of_visited(r.linf); }}}};
constexpr std::array<Column, 2> kIsoColumns{
    {{"iso_visited", "elements visited for the isosurface",
      [](const StudyRow& r) { return static_cast<double>(r.iso_visited); }},
     {"iso_leaves", "elements that hold the isosurface",
      [](const StudyRow& r) { return static_cast<double>(r.iso_leaves); }}}};

void write_csv(const std::filesystem::path& path, const Study& study, bool iso) {
    std::string text = "field,threshold";
    const auto columns = [&](auto&& f) {
        std::for_each(kColumns.begin(), kColumns.end(), f);
        if (iso) {
            std::for_each(kIsoColumns.begin(), kIsoColumns.end(), f);
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

/// A plot that the folder gets, as .svg and .png.
struct PlotFile {
    const Column* column;
    bool by_leaves;  ///< over the number of elements (quality) in place of the threshold
};

std::vector<PlotFile> plots_of(bool iso) {
    std::vector<PlotFile> plots;
    for (const Column& column : kColumns) {
        plots.push_back({&column, false});
    }
    for (std::size_t i = 2; i < 5; ++i) {
        plots.push_back({&kColumns.at(i), true});
    }
    for (const Column& column : kIsoColumns) {
        if (iso) {
            plots.push_back({&column, false});
        }
    }
    return plots;
}

constexpr const char* kTable = "study.csv";

std::array<std::string, 2> names_of(const PlotFile& plot) {
    const std::string name =
        fmt::format("{}{}", plot.column->name, plot.by_leaves ? "_by_leaves" : "");
    return {name + ".svg", name + ".png"};
}

void draw(const std::filesystem::path& folder, const Study& study, const PlotFile& file) {
    const auto x = [&](const StudyRow& r) {
        return file.by_leaves ? static_cast<double>(r.leaves) : r.threshold;
    };
    Plot plot;
    plot.x = file.by_leaves ? "elements" : "threshold, of the largest";
    plot.title = fmt::format("{} by {}", file.column->name, plot.x);
    plot.y = file.column->axis;
    for (const StudyRow& row : study.rows) {
        if (plot.series.empty() || plot.series.back().name != name_of(row.field)) {
            plot.series.push_back({std::string(name_of(row.field)), {}});
        }
        plot.series.back().points.emplace_back(x(row), file.column->of(row));
    }
    for (const std::string& name : names_of(file)) {
        draw_plot(folder / name, plot);
    }
}

/// The folder, made with those above it where they are missing; what was made and has stayed empty
/// is removed at the end.
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

Result run(Arguments& a, Progress& progress) {
    const StoreReader store(a.store);
    if (a.study.fields.empty()) {
        a.study.fields = store.layout().header().fields;
        std::erase_if(a.study.fields, is_of_cells);
    }
    const std::filesystem::path folder = a.folder;
    const Folder made(folder);
    const bool iso = a.study.iso.has_value();
    const std::vector<PlotFile> plots = plots_of(iso);
    std::vector<std::filesystem::path> outputs{folder / kTable};
    for (const PlotFile& plot : plots) {
        for (const std::string& name : names_of(plot)) {
            outputs.push_back(folder / name);
        }
    }
    for (const std::filesystem::path& output : outputs) {
        check_output(output, true, {store.path()});
    }
    const Study s = study(store, a.study, progress);
    write_csv(folder / kTable, s, iso);
    for (const PlotFile& plot : plots) {
        draw(folder, s, plot);
    }
    Result result;
    result.warning = leftovers_of(outputs);
    Json rows = Json::array();
    for (const StudyRow& r : s.rows) {
        rows.push_back({{"field", name_of(r.field)},
                        {"threshold", r.threshold},
                        {"visited", r.visited},
                        {"leaves", r.leaves},
                        {"l1", r.l1},
                        {"l2", r.l2},
                        {"linf", r.linf},
                        {"iso_visited", r.iso_visited},
                        {"iso_leaves", r.iso_leaves}});
    }
    result.json = {{"folder", a.folder}, {"all_elements", s.all_elements}, {"rows", rows}};
    result.text = fmt::format(
        "{}: study.csv and plots of {} fields at {} thresholds; the finest mesh "
        "has {} elements\n",
        a.folder, a.study.fields.size(), a.study.steps, s.all_elements);
    return result;
}

}  // namespace

void add_study(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<Arguments>();
    CLI::App* const c = add_command(
        app, chosen, "study",
        {"Compare a store's indicators: how many elements for how much error",
         "For thresholds from 1 down, as fractions of each field's largest value, the elements of "
         "the\n"
         "adaptive mesh of the whole volume, the cells of all levels that a traversal visits to "
         "find\n"
         "them, the error of the function on the mesh in three norms, and the efficiency 1 / (k "
         "error),\n"
         "k being the elements, or the visited cells as in the paper: as study.csv and as plots "
         "(.svg\n"
         "and .png). The volume must fit into the memory, 20 bytes a node.",
         "isonest preprocess map.h5 --indicators all -o map.isonest\n"
         "isonest study map.isonest --out map-study\n"
         "isonest study head.isonest --fields linf_bar,normal_bar --iso 120 --out head-study"});
    c->add_option("STORE", a->store, "made by isonest preprocess")->required();
    c->add_option("-o,--out", a->folder, "the folder for the table and the plots")
        ->required()
        ->type_name("FOLDER");
    StudyOptions& s = a->study;
    add_parsed(
        c, "--fields", [&s](const std::string& text) { s.fields = parse_fields("--fields", text); },
        "the fields to compare, with commas [all of the store]", "NAMES");
    add_parsed(
        c, "--iso", [&s](const std::string& text) { s.iso = parse_number("--iso", text); },
        "also count what extracting this isosurface visits", "V");
    add_parsed(
        c, "--steps",
        [&s](const std::string& text) {
            constexpr int kMost = 1000;
            s.steps = static_cast<int>(parse_integer("--steps", text, 2, kMost));
        },
        "number of thresholds [25]", "N");
    add_parsed(
        c, "--least", [&s](const std::string& text) { s.least = parse_number("--least", text); },
        "the least threshold [1e-4]", "T");
    add_memory(c, s.memory);
    add_threads(c, s.threads);
    c->callback(
        [a, &chosen] { chosen.run = [a](Progress& progress) { return run(*a, progress); }; });
}

}  // namespace isonest::detail::cli
