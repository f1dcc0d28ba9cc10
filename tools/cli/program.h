// The part that isonest and isonest-mpi share: parsing, running one command, messages and exit
// codes.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/frame.h>
#include <isonest/length_unit.h>
#include <isonest/progress.h>

#include "tools/cli/terminal/histogram_report.h"
#include "tools/cli/terminal/remedies.h"
#include "tools/cli/terminal/terminal_progress.h"

namespace isonest::detail {

// How a command is declared, what it returns, and how it is run.

class Communicator;
}  // namespace isonest::detail
namespace isonest::detail::publish {
struct PageFile;
}

namespace isonest::detail::cli {

/// "mm", or null if the unit is unknown.
Json unit_json(std::optional<LengthUnit> unit);
/// "RAS" or "LPS"; null if the frame is unknown.
Json frame_json(AnatomicalFrame frame);

/// The output of a command: `text` for people, `json` for programs.
struct Result {
    std::string text;
    std::string warning;  ///< written to stderr, and contained in the JSON
    Json json;
    int exit_code = 0;
    /// With several ranks: the figures of this rank, which become an entry of "ranks" in the JSON.
    Json rank = Json::object();
};

/// The command chosen on the command line.
struct Invocation {
    bool json = false;
    bool quiet = false;
    std::function<Result(Progress&)> run;
    std::vector<ProgressStage> stages = {};  ///< of its progress bar
    /// The ranks that run the command together (isonest-mpi); null for a single process. Set before
    /// the commands are declared.
    Communicator* ranks = nullptr;
};

/// The help text of a command.
struct Description {
    std::string summary;   ///< one line, also shown in the list of commands
    std::string details;   ///< the rest; wrapped by the help
    std::string examples;  ///< one per line, shown last
};

/// Declares a command with the options --json and --quiet.
CLI::App* add_command(CLI::App& app, Invocation& chosen, const std::string& name,
                      const Description& description);

void add_preprocess(CLI::App& app, Invocation& chosen);
void add_extract(CLI::App& app, Invocation& chosen);
void add_slice(CLI::App& app, Invocation& chosen);
void add_smooth(CLI::App& app, Invocation& chosen);
void add_study(CLI::App& app, Invocation& chosen);
void add_info(CLI::App& app, Invocation& chosen);
void add_export(CLI::App& app, Invocation& chosen);
void add_check(CLI::App& app, Invocation& chosen);
void add_make_volume(CLI::App& app, Invocation& chosen);
void add_picture(CLI::App& app, Invocation& chosen);
void add_view(CLI::App& app, Invocation& chosen);  ///< defined in the library isonest_view
/// The packages that a build needs to offer more of `publish` than --check.
inline constexpr const char* kPublishNeeds = "emscripten and node-acorn";
/// `page`: the files of the page of a site; if the WebAssembly library is missing, only --check is
/// available.
void add_publish(CLI::App& app, Invocation& chosen, const std::vector<publish::PageFile>& page);

/// Adds an option whose value is passed to `parse`, which throws Error{invalid_argument}. Its help
/// is in the table of options; `standard` replaces {} there.
CLI::Option* add_parsed(CLI::App* command, const std::string& name,
                        const std::function<void(const std::string&)>& parse,
                        const std::string& standard = {});

/// Adds --memory (bytes, with units) or --threads (0 = all cores).
void add_memory(CLI::App* command, std::uint64_t& memory);
void add_threads(CLI::App* command, int& threads);

/// A program: its name, its help and its commands.
struct Program {
    std::string name;
    std::string summary;  ///< first line of the help
    std::string footer;   ///< below the list of commands
    std::function<void(CLI::App& app, Invocation& chosen)> declare;
    /// Why this build lacks a command; empty for commands that it has or does not know.
    std::function<std::string(const std::string& command)> why_missing = {};
    /// The ranks of the run; null for a single process.
    Communicator* ranks = nullptr;
    /// What this build lacks besides formats: names, and the packages that they need.
    std::vector<std::pair<std::string, std::string>> missing = {};
};

/// How a run ended; not yet reported.
struct Outcome {
    int exit_code = 0;
    std::string message = {};  ///< of an error, for people
    Json error = {};           ///< of an error, for programs
    /// What goes to standard output.
    std::string text = {};
    std::string warning = {};
};

/// Parses the command line and runs the command. Throws nothing.
Outcome run_program(const Program& program, int argc, char** argv);
/// Whether --json is on the command line, even if the line cannot be parsed.
bool asks_for_json(int argc, char** argv);
/// Prints the outcome, as JSON if `json`, and returns the exit code.
int tell(const Program& program, const Outcome& outcome, bool json);
/// Sets up the memory allocator. Call it first in main().
void prepare_process();

}  // namespace isonest::detail::cli
