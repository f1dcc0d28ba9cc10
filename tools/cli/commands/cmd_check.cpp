// isonest check: the consistency tests of a store.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <isonest/check.h>
#include <isonest/error.h>
#include <isonest/open_volume.h>

#include "query/check/check.h"
#include "store/files/scratch_file.h"
#include "tools/cli/commands/input_store.h"
#include "tools/cli/commands/series_command.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/options/source_options.h"
#include "tools/cli/options/units.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {
namespace {

struct CheckArguments {
    std::string store;
    std::vector<std::string> source;
    SourceOptions source_options;
    CheckOptions check;
    Communicator* ranks = nullptr;
    std::string source_option;  ///< an option given for reading the source, or empty
    RemoteArguments remote;
};

std::uint64_t stored_chunks(const StoreLayout& layout) {
    std::int64_t count = 0;
    for (const ArrayInfo& array : layout.arrays()) {
        count += array.alias ? 0 : array.grid.product();
    }
    return static_cast<std::uint64_t>(count);
}

/// A damaged analysis is a finding. A stale one is not: it is never used.
void check_analyses(const StoreReader& store, Result& result) {
    result.json["analyses"] = Json::array();
    for (const FoundAnalysis& found : all_analyses(store, AnalysisDepth::bytes)) {
        result.json["analyses"].push_back(analysis_json(found));
        result.text += "analysis " + analysis_line(found);
        if (found.state == AnalysisState::damaged) {
            result.json["ok"] = false;
            result.exit_code = static_cast<int>(ErrorKind::corrupt);
        }
    }
}

const char* depth_text(CheckDepth depth) {
    return depth == CheckDepth::quick ? "quick" : depth == CheckDepth::deep ? "deep" : "standard";
}

Result run(CheckArguments& a, Progress& progress);

/// Checks the stores of all steps.
Result check_series(const CheckArguments& a, Progress& progress) {
    const Series series(a.store);
    if (a.ranks != nullptr) {
        require_no_series(a.store);
    }
    if (!a.source.empty()) {
        throw Error(ErrorKind::invalid_argument, {a.store},
                    "--source needs the store of one step, not a series");
    }
    Result all = run_on_steps(series, chosen_steps(series, ""), progress,
                              [&](std::size_t step, Progress& step_progress) {
                                  CheckArguments own = a;
                                  own.store = series.store(step).string();
                                  return run(own, step_progress);
                              });
    all.json["ok"] = all.exit_code == 0;
    return all;
}

Result run(CheckArguments& a, Progress& progress) {
    if (a.source.empty() && !a.source_option.empty()) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("{} needs --source: it describes how to read that volume",
                                a.source_option));
    }
    if (is_series(a.store)) {
        return check_series(a, progress);
    }
    const Store opened = open_required_store(a.store, a.remote, a.check.memory, progress);
    const StoreReader& store = opened.reader();
    const std::string path = store.path().string();
    if (a.ranks != nullptr) {
        require_same_store(*a.ranks, &store, path);
    }
    std::unique_ptr<VolumeSource> source;
    const bool is_first = a.ranks == nullptr || a.ranks->rank() == 0;
    if (!a.source.empty() && is_first) {
        reach_volume(a.source, a.remote, a.check.memory, a.source_options, progress,
                     is_url(a.store) ? a.store : "");
        a.source_options.max_heap = a.check.memory / 4;
        source = open_input(a.source, temporary_folder(), a.source_options);
        a.check.source = source.get();
    }
    const CheckReport r = check(store, a.check, progress, a.ranks);
    Result result;
    if (!is_first) {
        return result;
    }
    result.exit_code = r.failures > 0 ? static_cast<int>(ErrorKind::corrupt) : 0;
    result.json = {
        {"store", path},          {"ok", r.failures == 0},    {"depth", depth_text(a.check.depth)},
        {"chunks", r.chunks},     {"nodes", r.nodes},         {"cubes", r.cubes},
        {"failures", r.failures}, {"findings", Json::array()}};
    if (!a.source.empty()) {
        result.json["source"] = {{"labels", a.source_options.labels}};
    }
    check_analyses(store, result);
    const auto add_counts = [&] {
        add_fetched(opened, result);
        if (source != nullptr) {
            add_fetched(*source, result, "remote_source");
        }
    };
    for (const Finding& f : r.findings) {
        Json finding{{"test", f.test},   {"level", f.level},
                     {"field", f.field}, {"chunk", {f.chunk.x, f.chunk.y, f.chunk.z}},
                     {"node", nullptr},  {"message", f.message}};
        std::string node;
        if (f.node.x >= 0) {
            finding["node"] = {f.node.x, f.node.y, f.node.z};
            node = fmt::format(", node {} {} {}", f.node.x, f.node.y, f.node.z);
        }
        result.json["findings"].push_back(std::move(finding));
        result.text += fmt::format("{}: level {}, {}, chunk {} {} {}{}: {}\n", f.test, f.level,
                                   f.field, f.chunk.x, f.chunk.y, f.chunk.z, node, f.message);
    }
    if (r.failures > r.findings.size()) {
        result.text += fmt::format("... and {} more\n", r.failures - r.findings.size());
    }
    const bool only_values = std::all_of(r.findings.begin(), r.findings.end(),
                                         [](const Finding& f) { return f.test == "source"; });
    if (r.failures > 0 && only_values && store.has_missing() && !a.source_options.missing) {
        result.text +=
            "The store has missing values: if preprocess was given --missing V, give the same "
            "here.\n";
    }
    const std::vector<std::string>& unknown = store.layout().header().unknown_fields;
    if (!unknown.empty()) {
        result.warning = fmt::format("{}: uses the newer format version {}; not checked: {}", path,
                                     store.version().text(), fmt::join(unknown, ", "));
    }
    const DataRounding rounding = opened.rounding();
    result.json["tolerance"] = rounding.tolerance;
    const std::uint64_t all = stored_chunks(store.layout());
    result.json["chunks_total"] = all;
    if (r.chunks < all && r.failures == 0) {
        result.text += fmt::format(
            "{}: the table and a sample of {} of {} chunks are correct; without --quick all are "
            "read\n",
            path, r.chunks, all);
        add_counts();
        return result;
    }
    result.text += fmt::format(
        "{}: {} ({} chunks, {} nodes, {} cubes by brute force{})\n", path,
        r.failures == 0 ? std::string("all is well") : fmt::format("{} findings", r.failures),
        r.chunks, human_count(static_cast<double>(r.nodes)), r.cubes,
        a.source.empty() ? ""
        : rounding.none()
            ? ", values as in the source"
            : fmt::format(", values within {:.6g} of the source's", rounding.tolerance));
    add_counts();
    return result;
}

}  // namespace

void add_check(CLI::App& app, Invocation& chosen) {
    const auto a = std::make_shared<CheckArguments>();
    CLI::App* const c = add_command(
        app, chosen, "check",
        {"Check a store for damage and inconsistencies",
         "Checks all checksums, the chunk table, the agreement of the levels, and saturation "
         "across chunk borders; with --source also all values against the original volume, and a "
         "sample of the bounds by brute force. If anything is wrong, the exit code is 4; each "
         "finding names level, chunk and node.",
         "isonest check scan.isonest\n"
         "isonest check scan.isonest --quick\n"
         "isonest check head.isonest --source head.raw.gz --dims 256,256,113 --type uint16"});
    c->add_option("STORE", a->store)->required();
    CLI::Option* const quick =
        c->add_flag_callback("--quick", [a] { a->check.depth = CheckDepth::quick; });
    c->add_flag_callback("--deep", [a] { a->check.depth = CheckDepth::deep; })->excludes(quick);
    c->add_option("--source", a->source);
    add_source_options(c, a->source_options);
    add_memory(c, a->check.memory);
    add_threads(c, a->check.threads);
    add_remote_options(c, a->remote);
    c->callback([a, c, &chosen] {
        a->source_option = given_source_option(*c);
        a->ranks = chosen.ranks;
        chosen.run = [a](Progress& progress) {
            std::vector<std::string> inputs = a->source;
            inputs.push_back(a->store);
            return run_beside_fetching(a->remote, inputs, [&] { return run(*a, progress); });
        };
    });
}

}  // namespace isonest::detail::cli
