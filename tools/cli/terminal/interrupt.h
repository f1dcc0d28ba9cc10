// Ctrl-C and other signals, and files left by killed runs.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace isonest::detail::cli {

// Signals as a flag that long work can poll.

/// From now on SIGINT, SIGTERM, SIGHUP and SIGXCPU only set a flag; a second signal other than
/// SIGHUP ends the process at once (exit code 130). SIGHUP stays ignored if it was. SIGPIPE is
/// ignored. A write beyond a file size limit becomes an ordinary error. A mapped file that is
/// truncated while it is read ends the process with a message and exit code 6.
void watch_signals();

/// Registers a function that is called before a truncated file ends the process. It must be
/// async-signal-safe.
void before_a_bus_error_ends_the_program(void (*last)());

/// Restores the default action of SIGPIPE. Call it before printing the report, when the outputs are
/// complete: the program then ends without a message if the reader (e.g. head) has closed the pipe.
void let_a_closed_pipe_end_the_program();

/// Whether SIGINT, SIGTERM, SIGHUP or SIGXCPU has arrived. Thread-safe.
bool interrupted();

// Files left by killed runs.

/// Lists temporary files of `output` whose run has ended, and says how to remove them; empty if
/// there are none. Deletes nothing.
std::string leftovers_of(const std::filesystem::path& output);
/// The same for several outputs.
std::string leftovers_of(const std::vector<std::filesystem::path>& outputs);

}  // namespace isonest::detail::cli
