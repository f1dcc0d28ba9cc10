#include "store/files/open_shared.h"

#include <fcntl.h>
#include <linux/magic.h>
#include <sys/vfs.h>
#include <unistd.h>

namespace isonest::detail {

int open_shared(const char* path, int flags, mode_t mode) {
    const int fd = ::open(path, flags, mode);
    struct statfs system {};
    if (fd < 0 || ::fstatfs(fd, &system) != 0 || system.f_type != NFS_SUPER_MAGIC) {
        return fd;
    }
    // The client extends a write to its page unless the descriptor is synchronous
    // (nfs_can_extend_write), which cannot be set later.
    const int again = ::open(path, (flags & ~(O_CREAT | O_EXCL | O_TRUNC)) | O_DSYNC);
    ::close(fd);
    return again;
}

}  // namespace isonest::detail
