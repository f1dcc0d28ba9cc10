// What a rank of an interrupted run has done, for a later run with any number of ranks.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/levels/centre_store.h"
#include "preprocess/levels/level_sink.h"
#include "preprocess/ranks/pencils.h"
#include "store/container/format.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// ".STORE.ranks-" in `scratch`: the prefix of the names of all files of all ranks.
std::filesystem::path rank_files_prefix(const std::filesystem::path& scratch,
                                        const std::filesystem::path& store);

/// The blocks of the base pass that a rank has made: a file of their chunks, and a file with one
/// record per block, which contains what cannot be derived from the chunks. The files are created
/// with the first block, locked for the lifetime of this object, and removed by the destructor
/// unless keep() was called. Thread-safety: one thread.
class BlockJournal {
  public:
    /// `name`: an unused name with the prefix above. `identity`: what must be the same for a run
    /// that continues. `layout` and `centres` are borrowed.
    BlockJournal(std::filesystem::path name, std::string identity, const StoreLayout& layout,
                 const CentreStore& centres);
    /// Adds a block whose centres and ranges of cubes are in the store of centres. Returns the
    /// position of its chunks. Throws Error{io}.
    ChunkRun add(const Int3& block, std::span<const EncodedChunk> chunks);
    void keep();

  private:
    struct Files {
        ScratchFile blocks;
        ScratchFile chunks;
    };
    Files& files();

    std::filesystem::path name_;
    std::string identity_;
    const StoreLayout* layout_;
    const CentreStore* centres_;
    std::optional<Files> files_;
    std::uint64_t blocks_end_ = 0;
    std::uint64_t chunks_end_ = 0;
};

/// The blocks in all journals that a rank sees. Thread-safety: load() from any thread; the rest
/// from one.
class EarlierBlocks {
  public:
    /// Skips journals of runs that are alive. `scratch`: folder of the journals. Throws
    /// Error{invalid_argument} if one is of another input or has other options, and Error{io}.
    EarlierBlocks(const std::filesystem::path& scratch, const std::filesystem::path& store,
                  const std::string& identity, const StoreLayout& layout);
    ~EarlierBlocks();
    EarlierBlocks(const EarlierBlocks&) = delete;
    EarlierBlocks& operator=(const EarlierBlocks&) = delete;

    /// Whether all data of a block are present and intact.
    [[nodiscard]] bool has_whole(const Int3& block) const;
    /// The chunks of a block; puts its centres and ranges of cubes into `centres`. REQUIRES:
    /// has_whole(). Throws Error{io}.
    std::vector<EncodedChunk> load(const Int3& block, CentreStore& centres) const;
    /// The position of the block's chunks, valid for the lifetime of this object. REQUIRES:
    /// has_whole(). Throws Error{io}.
    [[nodiscard]] ChunkRun place_of(const Int3& block) const;
    /// Deletes the files that no other run reads. Called by all ranks that read them; the last one
    /// finds them unlocked.
    void remove() const;

  private:
    struct Place {
        std::uint64_t journal = 0;  ///< number of the journal, starting at 1; 0: none
        std::uint64_t offset = 0;
    };
    struct Journal {
        std::filesystem::path name;
        int blocks = -1;
        int chunks = -1;
    };
    struct Record;
    void read_journal(const std::filesystem::path& name, const std::string& identity);
    [[nodiscard]] std::optional<Record> record(const Journal& journal, std::uint64_t offset) const;
    [[nodiscard]] Record known_record(const Int3& block) const;
    [[nodiscard]] const Journal& journal_of(const Int3& block) const;
    [[nodiscard]] Place place_in_table(const Int3& block) const {
        return table_.as<Place>()[static_cast<std::size_t>(grid_.linear(block))];
    }

    const StoreLayout* layout_;
    Int3 grid_;
    ScratchFile table_;
    std::vector<Journal> journals_;
};

}  // namespace isonest::detail
