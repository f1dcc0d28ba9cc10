// What isonest and isonest-mpi share: parsing, running one command, messages and exit codes.
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

// What all commands share: how one is declared, what it returns, how it is run.

class Communicator;
}  // namespace isonest::detail
namespace isonest::detail::publish {
struct PageFile;
}

namespace isonest::detail::cli {

/// "mm", or null where it is not known.
Json unit_json(std::optional<LengthUnit> unit);
/// "RAS" or "LPS"; null where it is not known.
Json frame_json(AnatomicalFrame frame);

/// What a command has to say: `text` for people, `json` for programs.
struct Result {
    std::string text;
    std::string warning;  ///< on stderr, and in the JSON
    Json json;
    int exit_code = 0;
    /// What this rank alone has done, where there are several: of the JSON's "ranks".
    Json rank = Json::object();
};

/// The command that the command line chose.
struct Invocation {
    bool json = false;
    bool quiet = false;
    std::function<Result(Progress&)> run;
    std::vector<ProgressStage> stages = {};  ///< of its progress
    /// Set before the commands are declared: the ranks that run it together, of isonest-mpi. Null:
    /// a process alone.
    Communicator* ranks = nullptr;
};

/// What the help of a command says.
struct Description {
    std::string summary;   ///< one line, in the list of commands too
    std::string details;   ///< the rest; the help wraps it
    std::string examples;  ///< one a line, at the end
};

/// Declares a command with --json and --quiet.
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
void add_view(CLI::App& app, Invocation& chosen);  ///< of the library isonest_view
/// What a build needs for more of `publish` than its --check.
inline constexpr const char* kPublishNeeds = "emscripten and node-acorn";
/// `page`: of a site; without the library that runs in it, sites are only checked.
void add_publish(CLI::App& app, Invocation& chosen, const std::vector<publish::PageFile>& page);

/// Adds an option whose text is handed to `parse`, which throws Error{invalid_argument}. What the
/// help says of it is in the table of options; `standard` fills its {}.
CLI::Option* add_parsed(CLI::App* command, const std::string& name,
                        const std::function<void(const std::string&)>& parse,
                        const std::string& standard = {});

/// --memory (bytes, with units) and --threads (0 = all cores).
void add_memory(CLI::App* command, std::uint64_t& memory);
void add_threads(CLI::App* command, int& threads);

/// What a program says of itself, and what it can do.
struct Program {
    std::string name;
    std::string summary;  ///< on top of the help
    std::string footer;   ///< below the list of commands
    std::function<void(CLI::App& app, Invocation& chosen)> declare;
    /// Of commands that this build does not have: why. Nothing for others.
    std::function<std::string(const std::string& command)> why_missing = {};
    /// The ranks of the run; null: a process alone.
    Communicator* ranks = nullptr;
    /// Of what this build does not have beside formats: names, and the packages that it needs.
    std::vector<std::pair<std::string, std::string>> missing = {};
};

/// How a run ended, before anybody has been told.
struct Outcome {
    int exit_code = 0;
    std::string message = {};  ///< of an error, for people
    Json error = {};           ///< the same for programs
    /// What goes to standard output.
    std::string text = {};
    std::string warning = {};
};

/// Parses and runs; throws nothing. `json`: what was asked for, as far as that is known.
Outcome run_program(const Program& program, int argc, char** argv);
/// Whether --json is on the command line, whatever else is.
bool asks_for_json(int argc, char** argv);
/// Says how it ended, and returns the exit code.
int tell(const Program& program, const Outcome& outcome, bool json);
/// What every program does before all else.
void prepare_process();

}  // namespace isonest::detail::cli
