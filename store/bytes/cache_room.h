// How a CacheFolder stays within its bound: its count of bytes, and the removal of entries. Private
// to it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "store/files/file_descriptor.h"

namespace isonest::detail {

/// The folder of temporary files.
inline constexpr const char* kTemporariesOfCache = "new";

/// "01/23456789abcdef".
std::string cache_entry_name(std::uint64_t number);
/// What a file of this size takes on a disk.
std::uint64_t cache_entry_takes(std::uint64_t bytes);

/// The count of bytes of the cache whose folder is open as `root`, locked as long as the object.
class CacheCount {
  public:
    explicit CacheCount(int root);
    /// Why it can never be locked; else 0. Somebody who has it for 0.1 s is no error.
    [[nodiscard]] int error() const { return error_; }
    [[nodiscard]] bool is_locked() const { return is_locked_; }
    /// Nothing if it is not locked or not known.
    [[nodiscard]] std::optional<std::uint64_t> get() const;
    /// Returns 0, or the error. REQUIRES: is_locked().
    int set(std::uint64_t bytes) const;

  private:
    FileDescriptor file_;
    int error_ = 0;
    bool is_locked_ = false;
};

/// Removes the entries that were used least recently until `most` bytes are left, and puts the
/// count right. Does nothing while another process, or thread, does it. `own`: the name of the
/// caller's temporary file, which is not counted yet. Memory: 32 KB. Returns 0, or the error.
int make_cache_room(int root, std::uint64_t most, std::string_view own);

/// What processes have left that ended in the middle: files older than a minute. One that only
/// stood still loses what it was about to keep.
void remove_old_temporaries(int root);

}  // namespace isonest::detail
