// A folder of small files that several processes use as a cache with a common size limit.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "store/files/open_file.h"

namespace isonest::detail {

// How a CacheFolder keeps its size limit: the count of bytes, and the removal of entries. Private
// to it.

/// Name of the folder of temporary files.
inline constexpr const char* kTemporariesOfCache = "new";

/// "01/23456789abcdef".
std::string cache_entry_name(std::uint64_t number);
/// Disk space of a file of this size.
std::uint64_t cache_entry_takes(std::uint64_t bytes);

/// The byte count of the cache whose folder is open as `root`. It is locked for the lifetime of
/// this object.
class CacheCount {
  public:
    explicit CacheCount(int root);
    /// An error code if it can never be locked; else 0. It is not an error if another process holds
    /// it for 0.1 s.
    [[nodiscard]] int error() const { return error_; }
    [[nodiscard]] bool is_locked() const { return is_locked_; }
    /// Nullopt if it is not locked or not known.
    [[nodiscard]] std::optional<std::uint64_t> get() const;
    /// Returns 0 or the error code. REQUIRES: is_locked().
    int set(std::uint64_t bytes) const;

  private:
    FileDescriptor file_;
    int error_ = 0;
    bool is_locked_ = false;
};

/// Removes the least recently used entries until `most` bytes are left, and corrects the count.
/// Does nothing while another process or thread is doing it. `own`: the name of the caller's
/// temporary file, which is not counted yet. Memory: 32 KB. Returns 0 or the error code.
int make_cache_room(int root, std::uint64_t most, std::string_view own);

/// Removes temporary files older than a minute, which processes that died left behind. A process
/// that was merely suspended loses the entry that it was about to add.
void remove_old_temporaries(int root);

/// An entry is a file, identified by a number. It appears complete or not at all. The least
/// recently used entries make room for new ones (among entries whose last uses differ by less than
/// 2 % of their age, any may be removed). A process that dies leaves at most a temporary file,
/// which others remove, and a count that is too high, which is corrected when the limit is reached.
///
/// FOLDER/isonest-cache-1 contains the entries, by the hexadecimal digits of their numbers in 256
/// folders; the modification time of an entry is the time of its last use. Beside them are `new`,
/// temporary files; `bytes`, an upper bound of the bytes of all entries and its complement, locked
/// for microseconds; `removing`, locked while entries are removed. Only the owner has access.
///
/// Unreadable entries count as missing, and failed writes are skipped; warning() gives the reason.
/// Thread-safety: all methods from any thread.
class CacheFolder {
  public:
    /// Creates the folder. `max_bytes`: over all entries, counted in blocks of 4 KiB as on disk.
    /// Throws Error{invalid_argument, io} if the folder cannot be created.
    CacheFolder(const std::filesystem::path& folder, std::uint64_t max_bytes);
    CacheFolder(const CacheFolder&) = delete;
    CacheFolder& operator=(const CacheFolder&) = delete;
    ~CacheFolder();

    /// Nullopt if there is no such entry; empty if it has more than `most` bytes. Marks the entry
    /// as used.
    [[nodiscard]] std::optional<std::vector<std::byte>> read(std::uint64_t number,
                                                             std::size_t most);
    /// Replaces the entry with this number. If room has to be made, this takes as long as reading
    /// the sizes of all entries twice; what other processes write meanwhile beyond the limit is not
    /// added.
    void write(std::uint64_t number, std::span<const std::byte> bytes);
    void remove(std::uint64_t number);
    /// One line that says why the cache is off, or why nothing is added to it. Empty: it works.
    [[nodiscard]] std::string warning() const;

  private:
    enum class Off { writing, all };
    enum class Room { taken, missing, unknown };
    void turn_off(Off what, int error);
    void turn_off(Off what, const std::string& why);
    bool write_temporary(const std::string& name, std::span<const std::byte> bytes);
    Room take_room(std::uint64_t bytes);
    void make_room(std::uint64_t bytes, const std::string& temporary);
    void publish(const std::string& temporary, std::uint64_t number);

    std::filesystem::path folder_;
    std::uint64_t max_;
    int root_ = -1;
    std::string temporary_prefix_;
    std::atomic<std::uint64_t> temporaries_ = 0;
    std::atomic<bool> reads_ = true;
    std::atomic<bool> writes_ = true;
    std::mutex counting_;  ///< threads wait for each other even where processes do not
    mutable std::mutex mutex_;
    std::string warning_;
};

}  // namespace isonest::detail
