// Ctrl-C and kill, as a flag that long work can read.
#pragma once

namespace isonest::cli {

/// From now on SIGINT and SIGTERM only set a flag; the second one ends the process at once (130).
/// A write past a file size limit becomes an ordinary error; a mapped file that is truncated while
/// it is read ends the process with a message and exit code 6.
void watch_signals();

/// True once SIGINT or SIGTERM came. Thread-safe.
bool interrupted();

}  // namespace isonest::cli
