// Ctrl-C and kill, as a flag that long work can read.
#pragma once

namespace isonest::detail::cli {

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

}  // namespace isonest::detail::cli
