// Opening a file into which several machines write at the same time, each at places of its own.
#pragma once

#include <sys/types.h>

namespace isonest::detail {

/// As ::open(); the descriptor, or -1 and errno. On NFS, where a client writes whole pages back,
/// with what it believes to be around the bytes that were written, writes go through at once and
/// alone.
int open_shared(const char* path, int flags, mode_t mode = 0);

}  // namespace isonest::detail
