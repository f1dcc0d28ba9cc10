// What a rank of an interrupted run has done, for a run of as many ranks or of others.
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
#include "preprocess/levels/indicator_chunks.h"
#include "store/container/format.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// ".STORE.ranks-" in `scratch`, the beginning of the names of all files of all ranks.
std::filesystem::path rank_files_prefix(const std::filesystem::path& scratch,
                                        const std::filesystem::path& store);
/// The file of a journal's chunks.
std::filesystem::path chunks_name(const std::filesystem::path& journal);

/// Beside a rank's chunks: a record of each block of the base pass, with what the chunks do not
/// tell. Locked as long as it lives; removed at the end unless keep() was called. Thread-safety:
/// one thread.
class BlockJournal {
  public:
    /// `name`: with the prefix above, that of no file. `identity`: what must be the same for a run
    /// that goes on. `layout` and `centres` are borrowed. Throws Error{io}.
    BlockJournal(const std::filesystem::path& name, const std::string& identity,
                 const StoreLayout& layout, const CentreStore& centres);
    /// A block whose chunks lie from `offset` on in the file of chunks, and whose centres and
    /// ranges of cubes are in the store of centres. Throws Error{io}.
    void add(const Int3& block, std::span<const EncodedChunk> chunks, std::uint64_t offset);
    void keep() { file_.keep(); }
    /// Throws Error{io}.
    void sync() const { file_.sync(); }

  private:
    const StoreLayout* layout_;
    const CentreStore* centres_;
    ScratchFile file_;
    std::uint64_t end_ = 0;
};

/// The blocks in all journals that a rank sees. Thread-safety: load() from any thread; the rest
/// from one.
class EarlierBlocks {
  public:
    /// Of runs that are alive none. `scratch`: where the journals are. Throws
    /// Error{invalid_argument} if one is of another input or of other options, Error{io}.
    EarlierBlocks(const std::filesystem::path& scratch, const std::filesystem::path& store,
                  const std::string& identity, const StoreLayout& layout);
    ~EarlierBlocks();
    EarlierBlocks(const EarlierBlocks&) = delete;
    EarlierBlocks& operator=(const EarlierBlocks&) = delete;

    /// Whether all of a block is there and intact.
    [[nodiscard]] bool has_whole(const Int3& block) const;
    /// Its chunks; its centres and ranges of cubes go into `centres`. REQUIRES: has_whole().
    /// Throws Error{io}.
    std::vector<EncodedChunk> load(const Int3& block, CentreStore& centres) const;
    /// Deletes the files that no other run reads. Called by all ranks that read them, the last one
    /// finds them free.
    void remove() const;

  private:
    struct Place {
        std::uint64_t journal = 0;  ///< its number from 1 on; 0: none
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

    const StoreLayout* layout_;
    Int3 grid_;
    ScratchFile table_;
    std::vector<Journal> journals_;
};

}  // namespace isonest::detail
