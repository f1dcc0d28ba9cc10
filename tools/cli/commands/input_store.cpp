#include "tools/cli/commands/input_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <system_error>
#include <utility>

#include <isonest/error.h>
#include <isonest/preprocess.h>

#include "store/files/output_file.h"
#include "store/files/scratch_file.h"
#include "store/ranks/agreement.h"
#include "store/remote/open_location.h"
#include "tools/cli/options/source_options.h"
#include "tools/cli/options/units.h"
#include "tools/cli/terminal/interrupt.h"

namespace isonest::detail::cli {

void require_same_store(Communicator& ranks, const StoreReader* store, const std::string& name) {
    const std::string own = store != nullptr ? fmt::format("{:016x}", store->identity()) : "none";
    const std::string others = who_differs(ranks, own, own);
    if (ranks.rank() == 0 && !others.empty()) {
        throw Error(ErrorKind::invalid_argument, {name},
                    fmt::format("is {}, but not on ranks {}; all ranks must see the same file",
                                store != nullptr ? "a store" : "no store", others));
    }
    ranks.meet();
}

const char* name_of(AnalysisState state) {
    switch (state) {
        case AnalysisState::stale:
            return "stale";
        case AnalysisState::damaged:
            return "damaged";
        default:
            return "current";
    }
}

std::string analysis_line(const FoundAnalysis& found) {
    std::string line = found.path.string();
    if (found.file) {
        line += ": " + query_text(*found.file);
    }
    if (!found.problem.empty()) {
        line += fmt::format(": {}, {}; the next extraction that uses it replaces it",
                            name_of(found.state), found.problem);
    }
    return line + "\n";
}

Json analysis_json(const FoundAnalysis& found) {
    return {{"file", found.path.string()},
            {"query", found.file ? Json(query_text(*found.file)) : Json()},
            {"state", name_of(found.state)},
            {"problem", found.problem.empty() ? Json() : Json(found.problem)}};
}

namespace {

/// Deletes the file of an open store in its destructor. The disk space is freed when the store is
/// closed, however the process ends.
class RemovedName {
  public:
    explicit RemovedName(std::filesystem::path name) : name_(std::move(name)) {}
    RemovedName(const RemovedName&) = delete;
    RemovedName& operator=(const RemovedName&) = delete;
    ~RemovedName() {
        std::error_code ignored;
        std::filesystem::remove(name_, ignored);
    }

  private:
    std::filesystem::path name_;
};

void require_new(const std::filesystem::path& keep) {
    std::error_code ignored;
    if (std::filesystem::exists(std::filesystem::symlink_status(keep, ignored))) {
        throw Error(ErrorKind::invalid_argument, {keep.string()},
                    "--keep-store: the file exists; if it is the store of this volume, give it as "
                    "INPUT, else choose another name");
    }
}

}  // namespace

std::string InputArguments::shown() const {
    return shown_location(input.front());
}

void add_input_options(CLI::App* command, InputArguments& a, bool with_labels) {
    command->add_option("INPUT", a.input)->required();
    add_source_options(command, a.source, with_labels);
    command->add_option("--keep-store", a.keep);
    add_remote_options(command, a.remote);
}

void note_source_option(const CLI::App& command, InputArguments& a) {
    a.source_option = given_source_option(command);
}

std::optional<Store> open_if_store(InputArguments& a, std::uint64_t& memory, Progress& progress) {
    std::error_code ignored;
    const std::string& name = a.input.front();
    if (a.input.size() > 1 || name == "-" || std::filesystem::is_directory(name, ignored)) {
        return std::nullopt;
    }
    std::optional<Store> store;
    const std::uint64_t before = memory;
    try {
        store.emplace(open_store(name, a.remote, memory, progress));
    } catch (const Error& error) {
        if (!is_no_store(error) && !may_be_folder(error, name)) {
            throw;
        }
        memory = before;
        a.remote.opened = 0;
        return std::nullopt;
    }
    require_no_source_option(a.source_option, store->path().string());
    return store;
}

std::unique_ptr<VolumeSource> open_input_volume(InputArguments& a, std::uint64_t& memory,
                                                const std::filesystem::path& scratch,
                                                Progress& progress) {
    reach_volume(a.input, a.remote, memory, a.source, progress);
    // As in preprocess: a quarter of the budget is for the chunks of the input.
    a.source.max_heap = memory / 4;
    try {
        return open_input(a.input, scratch, a.source);
    } catch (const Error& error) {
        constexpr std::array kUnknown{RemedyKind::describe_numbers, RemedyKind::download};
        if (error.remedies().empty() ||
            std::find(kUnknown.begin(), kUnknown.end(), error.remedies().front().kind) ==
                kUnknown.end()) {
            throw;
        }
        throw Error(error.kind(), error.place(), "is not a store; " + error.problem(),
                    error.remedies());
    }
}

void MadeStore::report(Result& result) const {
    result.json["made_store"] = json;
    result.text += text;
    if (!warning.empty()) {
        result.warning += (result.warning.empty() ? "" : "\n") + warning;
    }
}

Error MadeStore::renamed(const Error& error) const {
    const std::string path = store.path().string();
    const auto with_name = [&](std::string said) {
        for (std::size_t at = said.find(path); at != std::string::npos;
             at = said.find(path, at + name.size())) {
            said.replace(at, path.size(), name);
        }
        return said;
    };
    ErrorPlace place = error.place();
    place.file = with_name(place.file);
    return {error.kind(), std::move(place), with_name(error.problem()), error.remedies()};
}

MadeStore make_store_of(VolumeSource& volume, const std::string& name, const StoreRequest& request,
                        Progress& progress) {
    const bool keeps = !request.keep.empty();
    if (keeps) {
        require_new(request.keep);
    }
    const std::filesystem::path path =
        keeps ? request.keep
              : temporary_name(request.output.empty() ? temporary_folder() / "isonest-store"
                                                      : request.output);
    PreprocessOptions options;
    options.memory = request.memory;
    options.threads = request.threads;
    options.fields = request.fields;
    const PreprocessReport report = preprocess(volume, path, options, progress);
    std::optional<RemovedName> removed;
    if (!keeps) {
        removed.emplace(path);
    }
    const std::string size = human_bytes(static_cast<double>(report.store_bytes));
    MadeStore made{Store(path),
                   keeps ? path.string() : name,
                   {},
                   {},
                   {{"bytes", report.store_bytes},
                    {"seconds", report.seconds},
                    {"kept", keeps ? Json(path.string()) : Json()},
                    {"notes", volume.notes()}}};
    made.text =
        keeps ? fmt::format("{}: the store of {}, {}, made in {}\n", path.string(), name, size,
                            human_seconds(report.seconds))
              : fmt::format("made a temporary store of {} ({}, {}); --keep-store STORE keeps it\n",
                            name, size, human_seconds(report.seconds));
    for (const std::string& note : volume.notes()) {
        made.text += fmt::format("note: {}\n", note);
    }
    Result fetched;
    add_fetched(volume, fetched);
    if (fetched.json.contains("remote")) {
        made.json["remote"] = fetched.json["remote"];
    }
    made.text += fetched.text;
    made.warning = fetched.warning;
    if (keeps) {
        const std::string left = leftovers_of(path);
        made.warning += (made.warning.empty() || left.empty() ? "" : "\n") + left;
    }
    return made;
}

void InputStore::report(Result& result) const {
    if (opened) {
        add_fetched(*opened, result);
    } else {
        made->report(result);
    }
}

InputStore open_or_make_store(InputArguments& a, StoreRequest request, std::uint64_t& memory,
                              Progress& progress) {
    InputStore found{open_if_store(a, memory, progress), {}};
    if (found.opened) {
        return found;
    }
    const std::filesystem::path folder = request.output.parent_path();
    const std::unique_ptr<VolumeSource> volume = open_input_volume(
        a, memory, request.output.empty() ? temporary_folder() : folder, progress);
    request.keep = a.keep;
    request.memory = memory;
    found.made.emplace(make_store_of(*volume, a.shown(), request, progress));
    return found;
}

std::vector<ProgressStage> with_store_stages(std::vector<ProgressStage> stages) {
    stages.insert(stages.begin(), {{"copy input", "copying the input", 0.5},
                                   {"levels 0-2", "reading the volume", 1}});
    return stages;
}

}  // namespace isonest::detail::cli
