// The store that a command works on: the one that INPUT names, or one that is made of a volume.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/field.h>
#include <isonest/open_volume.h>
#include <isonest/store.h>

#include "query/extract/kept_analysis.h"
#include "store/container/reader.h"
#include "store/ranks/communicator.h"
#include "tools/cli/options/remote_options.h"
#include "tools/cli/program.h"

namespace isonest::detail::cli {

// Whether all ranks have been given the same store.

/// Refuses at rank 0 if `name` is another store to some ranks than to rank 0, or if it is a store
/// to some ranks alone. `store`: null where it is none. Collective. Throws
/// Error{invalid_argument}.
void require_same_store(Communicator& ranks, const StoreReader* store, const std::string& name);

// What info and check say of the kept analyses of a store.

/// "current", "stale" or "damaged". REQUIRES: there is one.
const char* name_of(AnalysisState state);

/// File, query and state, with a line's end.
std::string analysis_line(const FoundAnalysis& found);
/// The same: "file", "query" (null where it is damaged), "state", "problem".
Json analysis_json(const FoundAnalysis& found);

/// What the options of a command say of its INPUT.
struct InputArguments {
    std::vector<std::string> input;  ///< a store; or a volume, whose slices may be several files
    SourceOptions source;            ///< how to read a volume
    std::string source_option;       ///< one of these that was given, or empty
    std::filesystem::path keep;      ///< where the store of a volume stays; empty: nowhere
    RemoteArguments remote;

    /// The first name, without passwords.
    [[nodiscard]] std::string shown() const;
};

/// INPUT, the options that say how a volume is read, --keep-store, --header and --cache.
/// `with_labels`: also --labels, of what the volume's values are.
void add_input_options(CLI::App* command, InputArguments& a, bool with_labels = true);
/// To be called once the options were parsed.
void note_source_option(const CLI::App& command, InputArguments& a);

/// The store that INPUT names; nothing if it is no store. Of one elsewhere a share of `memory` is
/// set aside, as open_store() says. Throws what open_store() throws for a store that is damaged or
/// cannot be reached.
std::optional<Store> open_if_store(InputArguments& a, std::uint64_t& memory, Progress& progress);

/// The volume that INPUT names. `scratch`: the folder for what comes by standard input. A quarter
/// of `memory` is for its chunks. Throws what open_volume() throws.
std::unique_ptr<VolumeSource> open_input_volume(InputArguments& a, std::uint64_t& memory,
                                                const std::filesystem::path& scratch,
                                                Progress& progress);

/// How the store of a volume is made.
struct StoreRequest {
    std::filesystem::path keep;    ///< its name; empty: it has none once it is open
    std::filesystem::path output;  ///< of the command: its folder holds the nameless store. Empty:
                                   ///< the system's folder for temporary files does
    std::vector<Field> fields = default_indicators();  ///< in any order, also several times
    std::uint64_t memory = 0;
    int threads = 0;
};

/// A store that was made of a volume, with what is to be said of it.
struct MadeStore {
    Store store;
    std::string name;  ///< of the store where it is kept, else of the volume
    std::string text;
    std::string warning;
    Json json;

    /// Adds "made_store", and lines of text.
    void report(Result& result) const;
    /// An error that names the store, with `name` in place of the temporary one.
    [[nodiscard]] Error renamed(const Error& error) const;
};

/// Makes the store of a volume, the same as preprocess makes. It takes disk space as long as it is
/// open. Throws what preprocess() throws, and Error{invalid_argument} where `keep` exists.
MadeStore make_store_of(VolumeSource& volume, const std::string& name, const StoreRequest& request,
                        Progress& progress);

/// A store that was opened, or made.
struct InputStore {
    std::optional<Store> opened;
    std::optional<MadeStore> made;

    [[nodiscard]] const Store& store() const { return opened ? *opened : made->store; }
    /// For people: its path, or the volume's name.
    [[nodiscard]] std::string name() const { return opened ? opened->path().string() : made->name; }
    /// What is said of how it came about.
    void report(Result& result) const;
};

/// The store that INPUT names, or that is made of the volume that it names: `request` says how, but
/// its `keep` and `memory` are those of `a` and `memory`. Throws what the functions above throw.
InputStore open_or_make_store(InputArguments& a, StoreRequest request, std::uint64_t& memory,
                              Progress& progress);

/// What run() returns; errors that it throws call the store by its name.
template <class Run>
Result run_on(const MadeStore& made, const Run& run) {
    try {
        return run();
    } catch (const Error& error) {
        throw made.renamed(error);
    }
}
template <class Run>
Result run_on(const InputStore& input, const Run& run) {
    return input.made ? run_on(*input.made, run) : run();
}

/// The stages of making a store, before those of the command.
std::vector<ProgressStage> with_store_stages(std::vector<ProgressStage> stages);

}  // namespace isonest::detail::cli
