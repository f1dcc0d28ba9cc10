// A folder of small files that several processes use as a cache, bounded together.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace isonest::detail {

/// An entry is a file under a number. It appears whole, and those that were used least recently
/// give way to new ones (of those whose last use is equally long ago, within 2 %, any). A process
/// that ends in the middle leaves at most a temporary file, which others remove, and a count that
/// is too high, which is put right when it is reached.
///
/// Below FOLDER/isonest-cache-1 are the entries, by the hexadecimal digits of their numbers in 256
/// folders; when one was used is its time of change. Beside them: `new`, temporary files; `bytes`,
/// a number that the bytes of all entries do not exceed, and its complement, locked for
/// microseconds; `removing`, locked while entries are removed. All is for its owner alone.
///
/// What cannot be read is not there, and what cannot be written is left out; warning() says why.
/// Thread-safety: all methods from any thread.
class CacheFolder {
  public:
    /// Makes the folder. `most_bytes`: of all entries together, in blocks of 4 KiB, as they lie on
    /// disks. Throws Error{invalid_argument, io} if there cannot be such a folder.
    CacheFolder(const std::filesystem::path& folder, std::uint64_t most_bytes);
    CacheFolder(const CacheFolder&) = delete;
    CacheFolder& operator=(const CacheFolder&) = delete;
    ~CacheFolder();

    /// Nothing if there is no such entry; no bytes of one that has more than `most`. It counts as
    /// used.
    [[nodiscard]] std::optional<std::vector<std::byte>> read(std::uint64_t number,
                                                             std::size_t most);
    /// In place of what has the number. If room has to be made, this takes as long as looking at
    /// the sizes of all entries twice; what others write meanwhile, beyond the bound, is left out.
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
    std::uint64_t most_;
    int root_ = -1;
    std::string temporary_prefix_;
    std::atomic<std::uint64_t> temporaries_ = 0;
    std::atomic<bool> reads_ = true;
    std::atomic<bool> writes_ = true;
    std::mutex counting_;  ///< threads wait for each other, also where processes do not
    mutable std::mutex mutex_;
    std::string warning_;
};

}  // namespace isonest::detail
