// Resuming a preprocessing run that was interrupted.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/progress.h>
#include <isonest/volume_source.h>

#include "preprocess/levels/centre_store.h"
#include "store/container/chunk_source.h"
#include "store/container/format.h"
#include "store/container/writer.h"
#include "store/files/open_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

// The progress of a preprocessing run, written beside its unfinished store. If the run is
// interrupted, another one can continue from there.

/// All work up to this point is in the unfinished store and in the centres' file.
struct Checkpoint {
    std::int32_t level = 0;     ///< 2: of the pass that makes levels 0 to 2; higher: that level
    std::int64_t rows = 0;      ///< level 2: rows of base blocks (along z) that are complete
    std::uint64_t centres = 0;  ///< checksum of what this row or level added to the centres' file
    std::uint64_t ranges = 0;  ///< level 2: checksum of the ranges of the row's cubes, also in that
                               ///< file
    bool operator==(const Checkpoint&) const = default;
};

/// One record of the journal, as stored (little endian, 64 bytes).
struct JournalRecord {
    enum Kind : std::uint32_t { chunk_kind = 1, checkpoint_kind = 2 };
    std::uint32_t kind = 0;
    std::uint32_t array = 0;  ///< chunk: position in StoreLayout::arrays(); checkpoint: level
    std::int64_t index = 0;   ///< chunk: its position in the array's grid; checkpoint: rows
    ChunkRow row;  ///< checkpoint: `checksum` is that of the centres, `offset` that of the ranges
    std::uint64_t check = 0;  ///< XXH64 of the bytes before

    [[nodiscard]] std::uint64_t expected_check() const;
};
static_assert(sizeof(JournalRecord) == 64);

/// "STORE's temporary name" + ".journal" and ".centres".
std::filesystem::path journal_name(const std::filesystem::path& temporary);
std::filesystem::path centres_name(const std::filesystem::path& temporary);

/// Appends to a journal. The file is locked for the lifetime of this object, so that others see
/// that the run is alive, and removed by the destructor unless keep() was called. In a file that
/// was kept, records after the last checkpoint may be missing. Thread-safety: one thread at a time.
class RunJournal {
  public:
    /// `identity`: what must be the same for a run that continues, line by line. Throws Error{io}.
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

// Checks whether an interrupted run's finished values are those of the input.

/// Compares the first and the last plane covered by `done` with those of `store`. A source that can
/// only be read in order is not compared. Throws Error{invalid_argument} with the place where they
/// differ, and what the source throws.
void require_same_values(VolumeSource& source, const ChunkSource& store, const Checkpoint& done);

/// For Checkpoint::centres: checksum of what a row of base blocks or a level put into `centres`.
/// `chunk`: of the store.
std::uint64_t checkpoint_checksum(const CentreStore& centres, int chunk, int level,
                                  std::int64_t rows);

/// For Checkpoint::ranges.
std::uint64_t ranges_checksum(const CentreStore& centres, int chunk, std::int64_t rows);

/// Files left behind by an interrupted run: its unfinished store, its journal and its centres'
/// file. The journal is locked for the lifetime of this object, if the file system supports it, so
/// that no other process uses them.
class InterruptedRun {
  public:
    /// Finds the run that came furthest among those with this `identity`; nullopt if there is none.
    /// Runs that are alive, or found by another process, are skipped. Throws
    /// Error{invalid_argument} if all leftovers are of other inputs or options, and says which
    /// differ.
    static std::optional<InterruptedRun> find(const std::filesystem::path& store,
                                              const std::string& identity);

    /// Writes what is complete and intact into `writer`, `centres` and `journal`, in the order in
    /// which it was first written, so that the finished bytes are the same. Returns where to
    /// continue (level 0: nothing was complete). Throws Error{io, cancelled}.
    Checkpoint replay(StoreWriter& writer, CentreStore& centres, RunJournal& journal,
                      Progress& progress);
    /// Deletes the files.
    void remove() const;
    /// Number of chunks that replay() wrote.
    [[nodiscard]] std::uint64_t chunks() const { return chunks_; }

  private:
    explicit InterruptedRun(FileDescriptor lock) : lock_(std::move(lock)) {}

    struct Mark {
        Checkpoint done;
        std::uint64_t chunks = 0;  ///< number of chunk records before it in the journal
    };
    FileDescriptor lock_;
    std::filesystem::path temporary_;
    std::uint64_t records_ = 0;  ///< offset of the records in the journal
    std::vector<Mark> marks_;
    std::uint64_t chunks_ = 0;
};

}  // namespace isonest::detail
