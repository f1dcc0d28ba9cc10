// Going on with a preprocessing run that was interrupted.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/progress.h>

#include "preprocess/levels/centre_store.h"
#include "preprocess/levels/run_journal.h"
#include "store/container/writer.h"
#include "store/files/file_descriptor.h"

namespace isonest::detail {

/// For Checkpoint::centres: of what a row of base blocks or a level put into `centres`. `chunk`: of
/// the store.
std::uint64_t checkpoint_checksum(const CentreStore& centres, int chunk, int level,
                                  std::int64_t rows);

/// For Checkpoint::ranges.
std::uint64_t ranges_checksum(const CentreStore& centres, int chunk, std::int64_t rows);

/// What an interrupted run left: its unfinished store, its journal and its centres' file. As long
/// as the object lives its journal is locked, where the file system can, so that nobody else finds
/// it.
class InterruptedRun {
  public:
    /// The one that came furthest among those that have `identity`; none if there is no leftover.
    /// Runs that are alive, or found by another process, are passed over.
    /// Throws Error{invalid_argument} if all leftovers are of other inputs or options, and says
    /// which differ.
    static std::optional<InterruptedRun> find(const std::filesystem::path& store,
                                              const std::string& identity);

    /// Writes into `writer`, `centres` and `journal` what is complete and intact, in the order in
    /// which it was written first, so that the finished bytes are the same; returns where to go on
    /// (level 0: nothing was complete). Throws Error{io, cancelled}.
    Checkpoint replay(StoreWriter& writer, CentreStore& centres, RunJournal& journal,
                      Progress& progress);
    /// Deletes the files.
    void remove() const;
    /// How many replay() wrote.
    [[nodiscard]] std::uint64_t chunks() const { return chunks_; }

  private:
    explicit InterruptedRun(FileDescriptor lock) : lock_(std::move(lock)) {}

    struct Mark {
        Checkpoint done;
        std::uint64_t chunks = 0;  ///< before it in the journal
    };
    FileDescriptor lock_;
    std::filesystem::path temporary_;
    std::uint64_t records_ = 0;  ///< where they begin in the journal
    std::vector<Mark> marks_;
    std::uint64_t chunks_ = 0;
};

}  // namespace isonest::detail
