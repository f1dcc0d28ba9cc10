// Ctrl-C and kill, and what a killed run left behind.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace isonest::detail::cli {

// Ctrl-C and kill, as a flag that long work can read.

/// From now on SIGINT, SIGTERM, SIGHUP and SIGXCPU only set a flag; the second one (not a SIGHUP)
/// ends the process at once (130). SIGHUP stays ignored where it is. SIGPIPE is ignored. A write
/// past a file size limit becomes an ordinary error; a mapped file that is truncated while it is
/// read ends the process with a message and exit code 6.
void watch_signals();

/// Called, if a truncated file ends the process, before it ends: async-signal-safe.
void before_a_bus_error_ends_the_program(void (*last)());

/// For the report, when the outputs are done: a reader that went away (head) ends the program as is
/// usual, without a message.
void let_a_closed_pipe_end_the_program();

/// True once one of the first four came. Thread-safe.
bool interrupted();

// What a killed run left behind.

/// Names the temporary files of `output` whose run is over, and how to remove them; empty if there
/// are none. Deletes nothing.
std::string leftovers_of(const std::filesystem::path& output);
/// The same for several outputs.
std::string leftovers_of(const std::vector<std::filesystem::path>& outputs);

}  // namespace isonest::detail::cli
