// What a preprocessing run has done so far, written beside its unfinished store: if the run is
// interrupted, another one can go on from there (see preprocess/levels/resume.h).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "store/container/format.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// All work up to here is in the unfinished store and in the centres' file.
struct Checkpoint {
    std::int32_t level = 0;     ///< 2: of the pass that makes levels 0 to 2; above: that level
    std::int64_t rows = 0;      ///< level 2: rows of base blocks (along z) that are complete
    std::uint64_t centres = 0;  ///< checksum of what this row or level added to the centres' file
    std::uint64_t ranges = 0;   ///< level 2: of the ranges of the row's cubes, in that file too
    bool operator==(const Checkpoint&) const = default;
};

/// One entry of the journal's file, as stored (little endian, 64 bytes).
struct JournalRecord {
    enum Kind : std::uint32_t { chunk_kind = 1, checkpoint_kind = 2 };
    std::uint32_t kind = 0;
    std::uint32_t array = 0;  ///< chunk: position in StoreLayout::arrays(); checkpoint: level
    std::int64_t index = 0;   ///< chunk: its position in the array's grid; checkpoint: rows
    ChunkRow row;  ///< checkpoint: `checksum` is that of the centres, `offset` of the ranges
    std::uint64_t check = 0;  ///< XXH64 of the bytes before

    [[nodiscard]] std::uint64_t expected_check() const;
};
static_assert(sizeof(JournalRecord) == 64);

/// "STORE's temporary name" + ".journal" and ".centres".
std::filesystem::path journal_name(const std::filesystem::path& temporary);
std::filesystem::path centres_name(const std::filesystem::path& temporary);

/// Appends to a journal. The file is locked as long as the object lives, so that others see that
/// the run is alive; then it is removed unless keep() was called. What comes after the last
/// checkpoint may be missing in a file that was kept. Thread-safety: one thread at a time.
class RunJournal {
  public:
    /// `identity` says, line by line, what has to be the same for a run that goes on.
    /// Throws Error{io}.
    RunJournal(const std::filesystem::path& temporary, const std::string& identity);

    /// Throw Error{io}.
    void chunk(std::size_t array, std::int64_t index, const ChunkRow& row);
    void checkpoint(const Checkpoint& done);
    void keep() { file_.keep(); }
    [[nodiscard]] std::uint64_t checkpoints() const { return checkpoints_; }

  private:
    void append(JournalRecord record);
    void flush();
    void write(std::span<const std::byte> bytes);

    ScratchFile file_;
    std::uint64_t end_ = 0;
    std::uint64_t checkpoints_ = 0;
    std::vector<JournalRecord> pending_;
};

}  // namespace isonest::detail
