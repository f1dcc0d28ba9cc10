// isonest preprocess: converts a volume to a store.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <isonest/error.h>
#include <isonest/open_volume.h>
#include <isonest/own_indicator.h>
#include <isonest/preprocess.h>
#include <isonest/series.h>
#include <isonest/tolerance.h>

#include "preprocess/ranks/preprocess_on_ranks.h"
#include "store/container/format.h"
#include "store/ranks/communicator.h"
#include "tools/cli/commands/preprocess_command.h"
#include "tools/cli/options/extract_options.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/source_options.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"
#include "tools/cli/terminal/interrupt.h"
#include "tools/cli/terminal/terminal_text.h"

namespace isonest::detail::cli {
namespace {

/// With several ranks, rank 0 returns the whole report. `rank`: receives the figures of this rank.
PreprocessReport run_on(Communicator* ranks, VolumeSource& source, const PreprocessArguments& a,
                        Json& rank, Progress& progress) {
    if (ranks == nullptr) {
        return preprocess(source, a.store, a.preprocess, progress);
    }
    const RanksReport r =
        preprocess_on_ranks(*ranks, source, a.store, a.preprocess, a.scratch, progress);
    rank = {{"input_bytes", r.input_bytes},
            {"store_bytes", r.store_bytes},
            {"seconds_in_passes", r.passes},
            {"seconds_writing", r.writing},
            {"seconds_alone", r.alone}};
    return r.whole;
}

/// A volume of numbers for an own indicator, and the indicator.
struct OwnVolume {
    std::unique_ptr<VolumeSource> numbers;
    OwnIndicator indicator;
};

OwnVolume open_own(const std::string& text, const PreprocessArguments& a, Progress& progress) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || equals + 1 == text.size()) {
        throw Error(ErrorKind::invalid_argument, fmt::format("--own '{}': give NAME=FILE", text));
    }
    const std::string file = text.substr(equals + 1);
    SourceOptions options;
    options.max_heap = a.preprocess.memory / 4;
    OwnVolume opened;
    try {
        opened.numbers = open_volume(std::filesystem::path(file), options);
    } catch (const Error& error) {
        const auto& remedies = error.remedies();
        if (std::none_of(remedies.begin(), remedies.end(),
                         [](const Remedy& r) { return r.kind == RemedyKind::describe_numbers; })) {
            throw;
        }
        throw Error(ErrorKind::invalid_argument, {file},
                    "--own needs a file that describes its numbers, such as .npy or .nrrd");
    }
    const std::filesystem::path beside = std::filesystem::path(a.store).parent_path();
    opened.indicator = own_indicator(text.substr(0, equals), *opened.numbers,
                                     !a.scratch.empty() ? std::filesystem::path(a.scratch)
                                     : beside.empty()   ? "."
                                                        : beside,
                                     progress);
    return opened;
}

/// "2.5", "0.5%", "bits:4" or "auto".
ValueTolerance parse_tolerance(const std::string& text) {
    const std::string option = "--tolerance";
    constexpr std::string_view kBits = "bits:";
    if (text == "auto") {
        return WithinNoise{};
    }
    if (text.starts_with(kBits)) {
        return WithoutLowBits{
            static_cast<int>(parse_integer(option, text.substr(kBits.size()), 0, 31))};
    }
    const bool is_part = text.ends_with('%');
    const double number = parse_number(option, is_part ? text.substr(0, text.size() - 1) : text);
    if (!(number >= 0) || (is_part && number > 100)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("--tolerance '{}': give a number >= 0, a percentage of the range, "
                                "bits:N or auto",
                                text));
    }
    return is_part ? ValueTolerance(WithinRangePart{number / 100})
                   : ValueTolerance(WithinValue{number});
}

/// The rounding of the volume's values, and why it was chosen.
struct ChosenRounding {
    DataRounding rounding;
    std::string reason;
};

std::string reason_of(const ValueTolerance& tolerance, const ValueSurvey& survey) {
    if (std::holds_alternative<WithinNoise>(tolerance)) {
        return survey.noise > 0
                   ? fmt::format("half the noise, whose standard deviation is about {:.3g}",
                                 survey.noise)
                   : "the values show no noise";
    }
    return std::holds_alternative<WithinRangePart>(tolerance)
               ? "of the range " + human_range(survey.min, survey.max)
               : "";
}

/// Reads the volume once if the tolerance depends on its values: on rank 0, if there are several.
/// `source` is opened again if it can be read only once.
ChosenRounding choose_rounding(PreprocessArguments& a, Communicator* ranks,
                               std::unique_ptr<VolumeSource>& source, Progress& progress) {
    const ValueType type = source->describe().type;
    if (!needs_survey(a.tolerance)) {
        return {rounding_of(a.tolerance, type), ""};
    }
    if (source->sequential() && a.input == std::vector<std::string>{"-"}) {
        throw Error(ErrorKind::invalid_argument,
                    "--tolerance: a percentage and auto need the values twice, and a stream from "
                    "standard input is read once; give the tolerance in values");
    }
    std::array<double, 3> numbers{};
    if (ranks == nullptr || ranks->rank() == 0) {
        const ValueSurvey survey =
            survey_values(*source, a.tolerance, a.preprocess.memory, progress);
        numbers = {survey.min, survey.max, survey.noise};
        if (source->sequential()) {
            source = open_input(a.input, std::filesystem::path(a.store).parent_path(), a.source);
        }
    }
    if (ranks != nullptr) {
        const std::string bytes = ranks->broadcast(
            std::string(reinterpret_cast<const char*>(numbers.data()), sizeof(numbers)));
        std::memcpy(numbers.data(), bytes.data(), sizeof(numbers));
    }
    const ValueSurvey survey{numbers[0], numbers[1], numbers[2]};
    return {rounding_of(a.tolerance, type, survey), reason_of(a.tolerance, survey)};
}

}  // namespace

Result preprocess_volume(PreprocessArguments& a, Communicator* ranks, Progress& progress) {
    reach_volume(a.input, a.remote, a.preprocess.memory, a.source, progress);
    // A quarter of the budget is enough for the chunks of the input; the passes need the rest.
    a.source.max_heap = a.preprocess.memory / 4;
    std::unique_ptr<VolumeSource> source =
        open_input(a.input, std::filesystem::path(a.store).parent_path(), a.source);
    const VolumeDescription volume = source->describe();
    const std::string type(volume.labels ? "int64" : name_of(volume.type));
    std::vector<OwnVolume> own;
    for (const std::string& text : a.own) {
        own.push_back(open_own(text, a, progress));
        a.preprocess.own.push_back(own.back().indicator);
    }
    const ChosenRounding chosen = choose_rounding(a, ranks, source, progress);
    a.preprocess.rounding = chosen.rounding;
    Result result;
    const PreprocessReport r = run_on(ranks, *source, a, result.rank, progress);
    const double rate = r.seconds > 0 ? static_cast<double>(r.input_bytes) / r.seconds : 0;
    result.warning = leftovers_of(a.store);
    result.json = {{"store", a.store},
                   {"nodes", {r.nodes.x, r.nodes.y, r.nodes.z}},
                   {"type", type},
                   {"labels", a.source.labels},
                   {"unit", unit_json(source->describe().unit)},
                   {"frame", frame_json(source->describe().frame)},
                   {"levels", r.levels},
                   {"min_value", r.labels ? Json((*r.labels)[0]) : Json(r.min_value)},
                   {"max_value", r.labels ? Json((*r.labels)[1]) : Json(r.max_value)},
                   {"has_missing", r.has_missing},
                   {"tolerance", chosen.rounding.tolerance},
                   {"tolerance_step", chosen.rounding.step},
                   {"tolerance_reason", chosen.reason.empty() ? Json() : Json(chosen.reason)},
                   {"input_bytes", r.input_bytes},
                   {"store_bytes", r.store_bytes},
                   {"chunks", r.chunks},
                   {"label_names", r.label_names},
                   {"resumed_chunks", r.resumed_chunks},
                   {"input_on_disk", r.input_on_disk},
                   {"folded_cells", r.curved ? Json(r.curved->folded) : Json()},
                   {"notes", source->notes()},
                   {"seconds", r.seconds}};
    result.text = fmt::format(
        "{}: {} x {} x {} {}, {}{}\n"
        "{} levels in {} chunks, {} ({:.2f} of the input's {}), in {} ({}/s)\n",
        a.store, r.nodes.x, r.nodes.y, r.nodes.z, type,
        r.labels
            ? fmt::format("labels {} to {}", (*r.labels)[0], (*r.labels)[1])
            : (a.source.labels ? "labels " : "values ") + human_range(r.min_value, r.max_value),
        r.has_missing ? ", some missing" : "", r.levels, r.chunks,
        human_bytes(static_cast<double>(r.store_bytes)),
        static_cast<double>(r.store_bytes) /
            static_cast<double>(std::max<std::uint64_t>(r.input_bytes, 1)),
        human_bytes(static_cast<double>(r.input_bytes)), human_seconds(r.seconds),
        human_bytes(rate));
    if (!chosen.rounding.none() || !chosen.reason.empty()) {
        result.text += fmt::format(
            "{}{}\n", chosen.rounding.none() ? "values as they are" : text_of(chosen.rounding),
            chosen.reason.empty() ? "" : ": " + chosen.reason);
    }
    if (r.label_names > 0) {
        result.text += fmt::format("names or colours of {} labels\n", r.label_names);
    }
    if (r.curved && r.curved->folded > 0) {
        const Int3& first = r.curved->first_folded;
        result.text += fmt::format(
            "note: {} cells of the curvilinear grid are folded or flat, the first at node {} {} "
            "{}\n",
            r.curved->folded, first.x, first.y, first.z);
    }
    for (const std::string& note : source->notes()) {
        result.text += fmt::format("note: {}\n", note);
    }
    add_fetched(*source, result);
    if (ranks != nullptr && result.json.contains("remote")) {
        result.rank["remote"] = result.json["remote"];
    }
    if (r.resumed_chunks > 0) {
        result.text +=
            fmt::format("{} chunks were reused from an interrupted run\n", r.resumed_chunks);
    }
    return result;
}

namespace {

/// Several files, each with a volume of its own, are a series.
bool are_steps(const std::vector<std::string>& input) {
    return input.size() > 1 && std::all_of(input.begin(), input.end(), holds_whole_volume);
}

Result run(PreprocessArguments& a, Communicator* ranks, Progress& progress) {
    if (!a.times && !a.append) {
        if (is_series(a.store)) {
            throw Error(ErrorKind::invalid_argument, {a.store},
                        "is a series; --append adds steps to it");
        }
        return preprocess_volume(a, ranks, progress);
    }
    if (ranks != nullptr) {
        throw Error(ErrorKind::invalid_argument,
                    "--times and --append: isonest-mpi cannot make a series; use isonest");
    }
    return preprocess_series(a, progress);
}

}  // namespace

void add_preprocess(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<PreprocessArguments>();
    CLI::App* const c = add_command(
        app, chosen, "preprocess",
        {"Convert a volume to a store, with all levels and error indicators",
         "The format of INPUT is detected from the first bytes; `isonest --version` lists those of "
         "this build. Raw data (also in gzip) need --dims and --type. NaN means missing data. "
         "Every input byte is read once, and the volume may be larger than memory. --resume "
         "continues an interrupted run. With --labels, 64-bit integers are stored exactly (0 to "
         "2^62 - 1), and the input's names and colours are kept; without it, they become float64 "
         "(up to 2^53). --tolerance rounds the values first, which makes the store much smaller; "
         "error bounds stay bounds for INPUT's values. Several files that hold a volume each, or "
         "--times, make a series: a folder with a store for each step in time.\n\nIndicators: " +
             list_names(all_fields()) + "; nodes (all but those of cells, hex_...); all.\n\n" +
             paraview_hint(),
         "isonest preprocess scan.h5 -o scan.isonest\n"
         "isonest preprocess scan.h5 --dataset /entry/data -o scan.isonest --memory 8G\n"
         "isonest preprocess scan.nii.gz --tolerance 0.5% -o scan.isonest\n"
         "isonest preprocess organs.seg.nrrd --labels -o organs.isonest\n"
         "isonest preprocess run_*.nc -o run.isonest\n"
         "isonest preprocess head.raw.gz --dims 256,256,113 --type uint16 --spacing 1,1,2 -o "
         "head.isonest"});
    c->add_option("INPUT", a->input)->required();
    c->add_option("-o,--output", a->store)->required();
    add_source_options(c, a->source);
    add_parsed(c, "--label-names", [a](const std::string& text) {
        a->source.label_names = text;
    })->needs(c->get_option("--labels"));
    PreprocessOptions& p = a->preprocess;
    add_memory(c, p.memory);
    add_threads(c, p.threads);
    add_parsed(
        c, "--chunk",
        [&p](const std::string& text) {
            p.chunk = static_cast<int>(parse_integer("--chunk", text, kMinChunk, kMaxChunk));
        },
        fmt::format("{}", p.chunk));
    add_parsed(
        c, "--compression",
        [&p](const std::string& text) {
            constexpr int kMax = 19;
            p.compression = static_cast<int>(parse_integer("--compression", text, 1, kMax));
        },
        fmt::format("{}", p.compression));
    add_parsed(
        c, "--indicators",
        [&p](const std::string& text) { p.fields = parse_indicators("--indicators", text); },
        fmt::format("{}", fmt::join(names_of(default_indicators()), ",")));
    CLI::Option* const tolerance = add_parsed(
        c, "--tolerance", [a](const std::string& text) { a->tolerance = parse_tolerance(text); });
    tolerance->excludes(c->get_option("--labels"));
    c->add_option("--own", a->own)->allow_extra_args(false);
    c->add_flag("--exact", p.exact);
    c->add_flag("--force", p.force);
    c->add_flag("--resume", p.resume);
    add_parsed(c, "--times", [a](const std::string& text) { a->times = parse_new_times(text); });
    c->add_flag("--append", a->append);
    if (chosen.ranks != nullptr) {
        c->add_option("--scratch", a->scratch);
    }
    add_remote_options(c, a->remote);
    c->callback([a, &chosen] {
        if (chosen.ranks == nullptr && !a->times && !a->append && are_steps(a->input)) {
            a->times.emplace();  // from the input
        }
        chosen.run = [a, ranks = chosen.ranks](Progress& progress) {
            return run_beside_fetching(a->remote, a->input,
                                       [&] { return run(*a, ranks, progress); });
        };
        if (!a->times && !a->append) {
            chosen.stages = {{"check the interrupted run", "checking the interrupted run", 0.1},
                             {"resume", "reusing finished work", 0.1},
                             {"copy input", "copying the input", 0.5},
                             {"survey", "reading the values for --tolerance", 0.3},
                             {"read indicator", "reading the numbers of --own", 0.2},
                             {"levels 0-2", "reading the volume", 1}};
        }
    });
}

}  // namespace isonest::detail::cli
