// A file into which several processes write, each at places of its own.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>

#include "store/files/early_write_back.h"

namespace isonest::detail {

/// One that another process has created. Thread-safety: write_at() from any thread.
class SharedFile {
  public:
    /// Follows no link. Throws Error{io}.
    explicit SharedFile(std::filesystem::path path);
    SharedFile(const SharedFile&) = delete;
    SharedFile& operator=(const SharedFile&) = delete;
    ~SharedFile();
    /// Throws Error{io}.
    void write_at(std::uint64_t offset, std::span<const std::byte> bytes) const;
    /// Copies some bytes of another file, from `from_offset` on, in the kernel; how many, 0 where
    /// it cannot.
    [[nodiscard]] std::uint64_t copy_from(int from, std::uint64_t from_offset, std::uint64_t offset,
                                          std::uint64_t bytes) const;
    /// Syncs what was written to disk. Throws Error{io}.
    void close();

  private:
    std::filesystem::path path_;
    int fd_;
    mutable EarlyWriteBack early_;
};

}  // namespace isonest::detail
