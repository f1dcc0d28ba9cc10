// isonest info: describes a store or a volume.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/tolerance.h>

#include "query/extract/extract.h"
#include "query/statistics/histogram.h"
#include "query/values/label_view.h"
#include "store/container/format.h"
#include "store/files/output_file.h"
#include "store/files/scratch_file.h"
#include "tools/cli/commands/input_store.h"
#include "tools/cli/commands/series_command.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"
#include "tools/cli/terminal/histogram_report.h"
#include "tools/cli/terminal/interrupt.h"
#include "tools/drawing/canvas.h"
#include "tools/drawing/plot.h"

namespace isonest::detail::cli {
namespace {

double ratio(const ArrayReport& r) {
    return r.stored_bytes > 0
               ? static_cast<double>(r.raw_bytes) / static_cast<double>(r.stored_bytes)
               : 0;
}

/// JSON has no infinity: the range of an array without finite values is null.
Json number(double value) {
    return std::isfinite(value) ? Json(value) : Json();
}

/// A value of the store; for a store of labels, the label.
Json value_json(const StoreHeader& header, double value) {
    const std::optional<std::int64_t> label = wide_label(header, value);
    return label ? Json(*label) : number(value);
}

Json to_json(const Int3& v) {
    return Json{v.x, v.y, v.z};
}

struct InfoArguments {
    InputArguments in;
    std::string plot;
    bool histogram = false;
    HistogramOptions options;
};

void add_histogram(const StoreReader& store, const InfoArguments& a, Result& result,
                   Progress& progress) {
    const Histogram h = histogram(store, a.options, progress);
    result.json["histogram"] = histogram_json(h);
    result.text += "\n" + histogram_text(h);
    if (a.plot.empty()) {
        return;
    }
    draw_histogram(a.plot, store.path().filename().string(), h,
                   [&](double value) { return value_text(h, value); });
    const std::string leftovers = leftovers_of(a.plot);
    result.warning += result.warning.empty() || leftovers.empty() ? leftovers : "\n" + leftovers;
    result.json["output"] = a.plot;
    result.text += fmt::format("{}: the histogram as a plot\n", a.plot);
}

void add_label_names(const LabelTable& names, Result& result) {
    constexpr std::size_t kMaxShown = 20;
    Json all = Json::array();
    for (std::size_t i = 0; i < names.size(); ++i) {
        const LabelName label = names.at(i);
        Json json = {{"id", label.id}};
        if (!label.name.empty()) {
            json["name"] = label.name;
        }
        if (label.color) {
            json["color"] = *label.color;
        }
        all.push_back(std::move(json));
        if (i == 0) {
            result.text +=
                fmt::format("\n{:>10} {:<8} name of {} labels\n", "label", "colour", names.size());
        }
        if (i < kMaxShown) {
            const LabelColor c = label.color.value_or(LabelColor{});
            result.text +=
                fmt::format("{:>10} {:<8} {}\n", label.id,
                            label.color ? fmt::format("#{:02x}{:02x}{:02x}", c[0], c[1], c[2]) : "",
                            label.name);
        }
    }
    if (names.size() > kMaxShown) {
        result.text += fmt::format("{:>10} and {} more\n", "...", names.size() - kMaxShown);
    }
    result.json["label_names"] = std::move(all);
}

void add_analyses(const StoreReader& store, Result& result) {
    result.json["analyses"] = Json::array();
    for (const FoundAnalysis& found : all_analyses(store, AnalysisDepth::attributes)) {
        Json json = analysis_json(found);
        std::string steps;
        if (found.file) {
            json["file_bytes"] = found.file->file_bytes();
            json["steps"] = Json::array();
            for (const AnalysisStep& step : found.file->steps()) {
                json["steps"].push_back({{"distance", step.bound}, {"triangles", step.triangles}});
                steps += fmt::format("{:>14.4g} {:>12}\n", step.bound, step.triangles);
            }
        }
        result.text += "\nanalysis " + analysis_line(found);
        if (!steps.empty()) {
            result.text += fmt::format("{:>14} {:>12}\n", "distance", "triangles") + steps;
        }
        result.json["analyses"].push_back(std::move(json));
    }
}

/// ", uneven: z (0, 10, 25, ... 5500 from the first node)".
std::string uneven_text(const UnevenAxesPtr& uneven) {
    std::string text;
    for (std::size_t a = 0; uneven && a < 3; ++a) {
        const std::vector<double>& at = uneven->offsets.at(a);
        constexpr std::size_t kSaid = 3;
        if (!at.empty()) {
            text += fmt::format(
                "{}{} ({:g}{}{:g} from the first node)", text.empty() ? "\nuneven axes: " : ", ",
                "xyz"[a], fmt::join(at.begin(), at.begin() + std::min(at.size(), kSaid), ", "),
                at.size() > kSaid + 1 ? ", ... " : ", ", at.back());
        }
    }
    return text;
}

Json uneven_json(const UnevenAxesPtr& uneven) {
    Json json = Json::object();
    for (std::size_t a = 0; uneven && a < 3; ++a) {
        if (!uneven->offsets.at(a).empty()) {
            json[std::string(1, "xyz"[a])] = uneven->offsets.at(a);
        }
    }
    return json;
}

/// What a store says of the positions of a curvilinear grid's nodes.
std::string curved_text(const CurvedNodes& nodes, std::optional<LengthUnit> unit,
                        AnatomicalFrame frame) {
    const auto three = [](const Double3& v) {
        return fmt::format("{:g} {:g} {:g}", v[0], v[1], v[2]);
    };
    const Int3& first = nodes.first_folded;
    return fmt::format("curvilinear: {} positions from {} to {}, mean step {}{}, {}, {}\n{}\n",
                       name_of(nodes.type), three(nodes.low), three(nodes.high), three(nodes.step),
                       nodes.mirrored ? ", mirrored" : "",
                       unit ? fmt::format("unit {} ({})", symbol_of(*unit), name_of(*unit))
                            : std::string("unknown unit"),
                       frame == AnatomicalFrame::unknown ? std::string("unknown patient axes")
                                                         : fmt::format("axes {}", name_of(frame)),
                       nodes.folded == 0
                           ? std::string("no folded cells")
                           : fmt::format("{} folded cells, the first at node {} {} {}",
                                         nodes.folded, first.x, first.y, first.z));
}

Json curved_json(const CurvedNodesPtr& nodes) {
    return !nodes
               ? Json()
               : Json{{"type", name_of(nodes->type)},
                      {"low", nodes->low},
                      {"high", nodes->high},
                      {"step", nodes->step},
                      {"mirrored", nodes->mirrored},
                      {"folded_cells", nodes->folded},
                      {"first_folded", nodes->folded == 0 ? Json() : to_json(nodes->first_folded)}};
}

/// "unit mm (millimetre), axes RAS", and the directions of the axes.
std::string place_text(const Double3& spacing, const Double3& origin,
                       std::optional<LengthUnit> unit, AnatomicalFrame frame,
                       const Directions& direction, const UnevenAxesPtr& uneven,
                       const Int3& nodes) {
    return fmt::format(
        "{} {:g} {:g} {:g}, origin {:g} {:g} {:g}, {}, {}{}{}\n",
        uneven ? "mean spacing" : "spacing", spacing[0], spacing[1], spacing[2], origin[0],
        origin[1], origin[2],
        unit ? fmt::format("unit {} ({})", symbol_of(*unit), name_of(*unit))
             : std::string("unknown unit"),
        frame == AnatomicalFrame::unknown ? std::string("unknown patient axes")
                                          : fmt::format("axes {}", name_of(frame)),
        direction == kAlongWorld
            ? ""
            : fmt::format(
                  "\naxes along ({:.5g}), ({:.5g}), ({:.5g}){}", fmt::join(direction[0], ", "),
                  fmt::join(direction[1], ", "), fmt::join(direction[2], ", "),
                  are_directions(direction) ? "" : ": sheared, " + sheared_axes(nodes, direction)),
        uneven_text(uneven));
}

/// Describes a volume from the metadata of its files; reads no values. `source`: the options with
/// which it was opened.
Result describe_volume(const VolumeSource& volume, const std::string& name,
                       const SourceOptions& source) {
    const VolumeDescription d = volume.describe();
    const std::string type(d.labels ? "int64" : name_of(d.type));
    const auto bytes =
        static_cast<double>(d.nodes.product()) * static_cast<double>(size_of(d.type));
    Result result;
    result.json = {{"volume", name},
                   {"nodes", to_json(d.nodes)},
                   {"type", type},
                   {"labels", source.labels},
                   {"spacing", d.spacing},
                   {"uneven", uneven_json(d.uneven)},
                   {"curvilinear", d.curved != nullptr},
                   {"origin", d.origin},
                   {"direction", d.direction},
                   {"sheared", !are_directions(d.direction)},
                   {"unit", unit_json(d.unit)},
                   {"frame", frame_json(d.frame)},
                   {"notes", volume.notes()}};
    result.text = fmt::format(
        "{}: a volume, {} x {} x {} {}, {}\n{}", name, d.nodes.x, d.nodes.y, d.nodes.z, type,
        human_bytes(bytes),
        (d.curved ? "curvilinear: each node has a position; on its lattice, " : "") +
            place_text(d.spacing, d.origin, d.unit, d.frame, d.direction, d.uneven, d.nodes));
    if (source.missing) {
        result.json["missing"] = *source.missing;
        result.text += fmt::format("the value {:g} stands for missing data\n", *source.missing);
    }
    if (source.big_endian) {
        result.json["endian"] = *source.big_endian ? "big" : "little";
    }
    for (const std::string& note : volume.notes()) {
        result.text += fmt::format("note: {}\n", note);
    }
    result.text += "--histogram reads the values; isonest preprocess makes a store\n";
    add_fetched(volume, result);
    return result;
}

Result describe_store(const Store& opened, const InfoArguments& a, const std::string& path,
                      Progress& progress) {
    const StoreReader& store = opened.reader();
    if (!a.plot.empty()) {
        if (!is_canvas(a.plot)) {
            throw Error(ErrorKind::invalid_argument, {a.plot}, "plots are written as .svg or .png");
        }
        check_output(a.plot, true, {store.path()});
    }
    const StoreHeader& h = store.layout().header();
    const std::vector<ArrayReport> arrays = describe_arrays(store);
    Result result;
    Json fields = Json::array();
    for (const Field field : h.fields) {
        fields.push_back(name_of(field));
    }
    const bool any = store.min_value() <= store.max_value();
    result.json = {{"store", path},
                   {"format", store.version().text()},
                   {"nodes", to_json(h.nodes)},
                   {"type", type_of_values(h)},
                   {"labels", h.labels},
                   {"spacing", h.spacing},
                   {"uneven", uneven_json(h.uneven)},
                   {"curvilinear", curved_json(h.curved)},
                   {"origin", h.origin},
                   {"direction", h.direction},
                   {"sheared", h.is_sheared()},
                   {"unit", unit_json(h.unit)},
                   {"frame", frame_json(h.frame)},
                   {"min_value", any ? value_json(h, store.min_value()) : Json()},
                   {"max_value", any ? value_json(h, store.max_value()) : Json()},
                   {"has_missing", store.has_missing()},
                   {"tolerance", h.rounding.tolerance},
                   {"tolerance_step", h.rounding.step},
                   {"levels", store.layout().lattice().top() + 1},
                   {"fields", fields},
                   {"unknown_fields", h.unknown_fields},
                   {"exact", h.exact},
                   {"chunk", h.chunk},
                   {"compression", h.compression},
                   {"chunks", store.layout().rows()},
                   {"cube_range_bytes", cube_range_bytes(store)},
                   {"file_bytes", store.file_bytes()},
                   {"arrays", Json::array()}};
    result.text = fmt::format(
        "{}: {} x {} x {} {}, {} levels, {}\n"
        "{}{}{}{}\n"
        "indicators {} ({}), chunks of {}^3 nodes, zstd level {}\n"
        "ranges of cubes: {}\n\n"
        "{:>5} {:<14} {:>18} {:>8} {:>10} {:>7}  {}\n",
        path, h.nodes.x, h.nodes.y, h.nodes.z, type_of_values(h),
        store.layout().lattice().top() + 1, human_bytes(static_cast<double>(store.file_bytes())),
        h.curved ? curved_text(*h.curved, h.unit, h.frame)
                 : place_text(h.spacing, h.origin, h.unit, h.frame, h.direction, h.uneven, h.nodes),
        value_text(h.labels, store.min_value(), store.max_value()),
        store.has_missing() ? ", some missing" : "",
        h.rounding.none() ? "" : "; rounded: " + text_of(h.rounding),
        h.fields.empty() ? std::string("none") : list_names(h.fields),
        h.exact ? "32-bit" : "16-bit, rounded up", h.chunk, h.compression,
        human_bytes(static_cast<double>(cube_range_bytes(store))), "level", "field", "nodes",
        "chunks", "stored", "ratio", "range");
    if (!h.unknown_fields.empty()) {
        result.warning = fmt::format("{}: of the newer format version {}; not read: {}", path,
                                     store.version().text(), fmt::join(h.unknown_fields, ", "));
    }
    for (const ArrayReport& r : arrays) {
        result.json["arrays"].push_back({{"level", r.level},
                                         {"field", name_of(r.field)},
                                         {"nodes", to_json(r.nodes)},
                                         {"chunk", to_json(r.chunk)},
                                         {"chunks", r.chunks},
                                         {"raw_bytes", r.raw_bytes},
                                         {"stored_bytes", r.stored_bytes},
                                         {"ratio", ratio(r)},
                                         {"min", r.labels ? Json((*r.labels)[0]) : number(r.min)},
                                         {"max", r.labels ? Json((*r.labels)[1]) : number(r.max)},
                                         {"alias", r.alias}});
        result.text +=
            fmt::format("{:>5} {:<14} {:>18} {:>8} {:>10} {:>7}  {}\n", r.level, name_of(r.field),
                        fmt::format("{}x{}x{}", r.nodes.x, r.nodes.y, r.nodes.z), r.chunks,
                        r.alias ? "shared" : human_bytes(static_cast<double>(r.stored_bytes)),
                        r.alias ? "" : fmt::format("{:.2f}", ratio(r)),
                        r.labels ? fmt::format("{} to {}", (*r.labels)[0], (*r.labels)[1])
                                 : human_range(r.min, r.max));
    }
    add_label_names(store.label_names(), result);
    add_analyses(store, result);
    if (a.histogram) {
        add_histogram(store, a, result, progress);
    }
    return result;
}

/// The times and stores of a series, and what its first store says about all of them.
Result describe_series(const Series& series, const InfoArguments& a) {
    if (a.histogram) {
        require_no_series(a.in.input.front());
    }
    Result result;
    result.json = series_json(series);
    result.json["steps"] = Json::array();
    std::uint64_t bytes = 0;
    std::string lines;
    for (std::size_t i = 0; i < series.steps().size(); ++i) {
        const SeriesStep& step = series.steps()[i];
        const std::uint64_t size = std::filesystem::file_size(series.store(i));
        bytes += size;
        result.json["steps"].push_back(
            {{"step", i}, {"time", step.time}, {"store", step.store}, {"file_bytes", size}});
        lines += fmt::format("{:>6} {:>16} {:>10}  {}\n", i, time_text(step.time),
                             human_bytes(static_cast<double>(size)), step.store);
    }
    result.json["file_bytes"] = bytes;
    result.text = fmt::format("{}: a series of {} steps, {}", series.folder().string(),
                              series.steps().size(), human_bytes(static_cast<double>(bytes)));
    if (series.steps().empty()) {
        result.text += "\n";
        return result;
    }
    const Store first(series.store(0));
    const StoreHeader& h = first.reader().layout().header();
    result.json.update({{"nodes", to_json(h.nodes)},
                        {"type", type_of_values(h)},
                        {"labels", h.labels},
                        {"spacing", h.spacing},
                        {"uneven", uneven_json(h.uneven)},
                        {"origin", h.origin},
                        {"unit", unit_json(h.unit)},
                        {"frame", frame_json(h.frame)}});
    result.text += fmt::format(
        ", each {} x {} x {} {}\n{}times {} to {}{}\n\n{:>6} {:>16} {:>10}  {}\n{}", h.nodes.x,
        h.nodes.y, h.nodes.z, type_of_values(h),
        h.curved ? curved_text(*h.curved, h.unit, h.frame)
                 : place_text(h.spacing, h.origin, h.unit, h.frame, h.direction, h.uneven, h.nodes),
        time_text(series.steps().front().time), time_text(series.steps().back().time),
        time_suffix(series.time_unit()), "step", "time", "size", "store", lines);
    return result;
}

Result run(InfoArguments& a, Progress& progress) {
    if (const std::optional<Series> series = open_if_series(a.in, nullptr)) {
        return describe_series(*series, a);
    }
    InputStore input{open_if_store(a.in, a.options.memory, progress), {}};
    if (!input.opened) {
        const std::unique_ptr<VolumeSource> volume =
            open_input_volume(a.in, a.options.memory, temporary_folder(), progress);
        if (!a.histogram && a.in.keep.empty()) {
            return describe_volume(*volume, a.in.shown(), a.in.source);
        }
        input.made.emplace(make_store_of(
            *volume, a.in.shown(),
            {a.in.keep, {}, default_indicators(), a.options.memory, a.options.threads}, progress));
    }
    Result result =
        run_on(input, [&] { return describe_store(input.store(), a, input.name(), progress); });
    input.report(result);
    return result;
}

}  // namespace

void add_info(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<InfoArguments>();
    CLI::App* const c = add_command(
        app, chosen, "info",
        {"Show what a store or a volume contains: size, type, position, range, levels, compression",
         "Of a store, only the header and the chunk table are read. --histogram reads the values "
         "too, and shows how often each occurs, how large the surface of each isovalue is, and "
         "suggested isovalues, whose surfaces are sharpest.",
         "isonest info scan.isonest\n"
         "isonest info scan.nii.gz\n"
         "isonest info scan.isonest --histogram -o histogram.png"});
    add_input_options(c, a->in);
    CLI::Option* const histogram = c->add_flag("--histogram", a->histogram);
    HistogramOptions& o = a->options;
    add_parsed(
        c, "--level",
        [&o](const std::string& text) {
            constexpr int kMax = 20;
            o.level = static_cast<int>(parse_integer("--level", text, 0, kMax));
        },
        fmt::format("{}", kMaxHistogramNodes >> 20));
    c->add_option("-o,--output", a->plot);
    add_memory(c, o.memory);
    add_threads(c, o.threads);
    for (const char* const name : {"--level", "--output", "--memory", "--threads"}) {
        c->get_option(name)->needs(histogram);
    }
    c->callback([a, c, &chosen] {
        note_source_option(*c, a->in);
        chosen.run = [a](Progress& progress) {
            return run_beside_fetching(a->in.remote, a->in.input,
                                       [&] { return run(*a, progress); });
        };
    });
}

}  // namespace isonest::detail::cli
