// What isonest and isonest-mpi share: parsing, running one command, messages and exit codes.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>

#include "tools/cli/command.h"
#include "tools/cli/terminal/remedies.h"

namespace isonest::detail::cli {

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
