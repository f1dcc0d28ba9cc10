// isonest study: the indicators compared on one store, as a table and plots.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <memory>

#include "query/study.h"
#include "store/error.h"
#include "store/output_file.h"
#include "tools/command.h"
#include "tools/extract_options.h"
#include "tools/fields.h"
#include "tools/plot.h"
#include "tools/units.h"

namespace isonest::cli {
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
constexpr std::array<Column, 8> kColumns{
    {{"visited", "elements of all levels",
      [](const StudyRow& r) { return static_cast<double>(r.visited); }},
     {"leaves", "elements k", [](const StudyRow& r) { return static_cast<double>(r.leaves); }},
     {"l1", "||P U - U||, L1", [](const StudyRow& r) { return r.l1; }},
     {"l2", "||P U - U||, L2", [](const StudyRow& r) { return r.l2; }},
     {"linf", "||P U - U||, L infinity", [](const StudyRow& r) { return r.linf; }},
     {"efficiency_l1", "1 / (k error), L1", [](const StudyRow& r) { return r.efficiency(r.l1); }},
     {"efficiency_l2", "1 / (k error), L2", [](const StudyRow& r) { return r.efficiency(r.l2); }},
     {"efficiency_linf", "1 / (k error), L infinity",
      [](const StudyRow& r) { return r.efficiency(r.linf); }}}};
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

/// Two plots of a column, over the threshold and (quality) over the number of elements.
void plot(const std::filesystem::path& folder, const Study& study, const Column& column,
          const char* suffix, const char* x_axis, Value x) {
    Plot plot;
    plot.title = fmt::format("{} by {}", column.name, x_axis);
    plot.x = x_axis;
    plot.y = column.axis;
    for (const StudyRow& row : study.rows) {
        if (plot.series.empty() || plot.series.back().name != name_of(row.field)) {
            plot.series.push_back({std::string(name_of(row.field)), {}});
        }
        plot.series.back().points.emplace_back(x(row), column.of(row));
    }
    for (const char* const end : {".svg", ".png"}) {
        draw_plot(folder / fmt::format("{}{}{}", column.name, suffix, end), plot);
    }
}

Result run(Arguments& a, Progress& progress) {
    const StoreReader store(a.store);
    if (a.study.fields.empty()) {
        a.study.fields = store.layout().header().fields;
    }
    const std::filesystem::path folder = a.folder;
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error) {
        throw Error(ErrorKind::io,
                    fmt::format("{}: cannot make this folder: {}", a.folder, error.message()));
    }
    const Study s = study(store, a.study, progress);
    const bool iso = a.study.iso.has_value();
    write_csv(folder / "study.csv", s, iso);
    const auto threshold = [](const StudyRow& r) { return r.threshold; };
    for (const Column& column : kColumns) {
        plot(folder, s, column, "", "threshold, of the largest", threshold);
    }
    for (std::size_t i = 2; i < 5; ++i) {
        plot(folder, s, kColumns.at(i), "_by_leaves", "elements k",
             [](const StudyRow& r) { return static_cast<double>(r.leaves); });
    }
    for (const Column& column : kIsoColumns) {
        if (iso) {
            plot(folder, s, column, "", "threshold, of the largest", threshold);
        }
    }
    Result result;
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
         "adaptive mesh of the whole volume, the error of the function on it in three norms, and "
         "the\n"
         "efficiency 1 / (k error): as study.csv and as plots (.svg and .png). The volume must fit "
         "into\n"
         "the memory, 20 bytes a node.",
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

}  // namespace isonest::cli
