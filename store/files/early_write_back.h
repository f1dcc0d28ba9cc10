// Lets the disk work while a file is still being made, so that the sync at its end finds little
// left to do.
#pragma once

#include <fcntl.h>

#include <atomic>
#include <cstdint>

namespace isonest::detail {

/// Thread-safe. Only a hint: where the file system refuses it, the sync does all.
class EarlyWriteBack {
  public:
    /// Call after every write, with any descriptor of the file.
    void wrote(int fd, std::uint64_t bytes) {
        if (pending_.fetch_add(bytes) + bytes >= kBatch) {
            pending_ = 0;
            ::sync_file_range(fd, 0, 0, SYNC_FILE_RANGE_WRITE);
        }
    }

  private:
    static constexpr std::uint64_t kBatch = 8U << 20U;
    std::atomic<std::uint64_t> pending_ = 0;
};

}  // namespace isonest::detail
