// The store that a command works on: opened from INPUT, or made from the volume that INPUT names.
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

/// Throws at rank 0 if the ranks do not all see the same store under `name`, or if only some of
/// them find a store. `store`: null if this rank found none. Collective. Throws
/// Error{invalid_argument}.
void require_same_store(Communicator& ranks, const StoreReader* store, const std::string& name);

// Kept analyses, as reported by info and check.

/// "current", "stale" or "damaged". REQUIRES: the analysis exists.
const char* name_of(AnalysisState state);

/// File, query and state, terminated by a newline.
std::string analysis_line(const FoundAnalysis& found);
/// The same as JSON: "file", "query" (null if damaged), "state", "problem".
Json analysis_json(const FoundAnalysis& found);

/// The options for the INPUT of a command.
struct InputArguments {
    std::vector<std::string>
        input;             ///< a store; or a volume, which may consist of several files (slices)
    SourceOptions source;  ///< how to read a volume
    std::string source_option;   ///< an option given for reading a volume, or empty
    std::filesystem::path keep;  ///< where to keep the store of a volume; empty: it is not kept
    RemoteArguments remote;

    /// The first name, without credentials.
    [[nodiscard]] std::string shown() const;
};

/// Adds INPUT, the options for reading a volume, --keep-store, --header and --cache. `with_labels`:
/// also --labels, which declares the volume's values to be labels.
void add_input_options(CLI::App* command, InputArguments& a, bool with_labels = true);
/// Sets a.source_option. Call it after the options were parsed.
void note_source_option(const CLI::App& command, InputArguments& a);

/// Opens the store that INPUT names; nothing if INPUT is not a store. For a remote store, part of
/// `memory` is set aside, see open_store(). Throws what open_store() throws if the store is damaged
/// or cannot be reached.
std::optional<Store> open_if_store(InputArguments& a, std::uint64_t& memory, Progress& progress);

/// Opens the volume that INPUT names. `scratch`: folder for a copy of standard input. A quarter of
/// `memory` is reserved for its chunks. Throws what open_volume() throws.
std::unique_ptr<VolumeSource> open_input_volume(InputArguments& a, std::uint64_t& memory,
                                                const std::filesystem::path& scratch,
                                                Progress& progress);

/// How to make the store of a volume.
struct StoreRequest {
    std::filesystem::path keep;    ///< file name; empty: the file is deleted once the store is open
    std::filesystem::path output;  ///< of the command; a store that is not kept is in its folder,
                                   ///< or, if empty, in the system's temporary folder
    std::vector<Field> fields = default_indicators();
    std::uint64_t memory = 0;
    int threads = 0;
};

/// A store made from a volume, and the report on making it.
struct MadeStore {
    Store store;
    std::string name;  ///< of the store if it is kept, else of the volume
    std::string text;
    std::string warning;
    Json json;

    /// Adds "made_store" and lines of text.
    void report(Result& result) const;
    /// The error with `name` in place of the store's temporary name.
    [[nodiscard]] Error renamed(const Error& error) const;
};

/// Makes the same store as preprocess. It occupies disk space while it is open. Throws what
/// preprocess() throws, and Error{invalid_argument} if `keep` exists.
MadeStore make_store_of(VolumeSource& volume, const std::string& name, const StoreRequest& request,
                        Progress& progress);

/// A store that was opened or made.
struct InputStore {
    std::optional<Store> opened;
    std::optional<MadeStore> made;

    [[nodiscard]] const Store& store() const { return opened ? *opened : made->store; }
    /// The path of the store, or the name of the volume, for messages.
    [[nodiscard]] std::string name() const { return opened ? opened->path().string() : made->name; }
    /// Reports how the store was obtained.
    void report(Result& result) const;
};

/// Opens the store that INPUT names, or makes one of the volume that it names according to
/// `request`, whose `keep` and `memory` are replaced by a.keep and `memory`. Throws what the
/// functions above throw.
InputStore open_or_make_store(InputArguments& a, StoreRequest request, std::uint64_t& memory,
                              Progress& progress);

/// Returns run(); errors that it throws are changed to show the store's name, see renamed().
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

/// Prepends the stages of making a store to those of the command.
std::vector<ProgressStage> with_store_stages(std::vector<ProgressStage> stages);

}  // namespace isonest::detail::cli
