// Which items of a sequence lie in which block, in temporary files.
#pragma once

#include <cstdint>
#include <limits>
#include <span>

#include "query/simplify/block_triangles.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Items of a block that follow each other in the sequence.
struct BlockRun {
    std::uint64_t first = 0;
    std::uint32_t count = 0;
    std::uint32_t block = 0;
};

/// A sequence in the order of a traversal has few of them, much fewer than items. Not thread-safe;
/// constant once it is sorted.
class BlockRuns {
  public:
    explicit BlockRuns(const ScratchFolder& folder) : runs_(folder) {}

    /// The block of the item that comes next.
    void add(std::uint32_t block) {
        if (run_.count == std::numeric_limits<std::uint32_t>::max() ||
            (run_.count > 0 && run_.block != block)) {
            put();
        }
        run_.block = block;
        ++run_.count;
    }
    void add(const BlockRun& run) { runs_.append(run); }
    /// After all were added. Throws Error{io}.
    void sort(std::uint32_t blocks) {
        put();
        runs_.sort(blocks);
    }
    /// In the order of the sequence. REQUIRES of what follows: sort() was called.
    [[nodiscard]] std::span<const BlockRun> of(std::uint32_t block) const {
        return runs_.of(block);
    }
    [[nodiscard]] std::span<const BlockRun> all() const { return runs_.all(); }

  private:
    void put() {
        if (run_.count > 0) {
            runs_.append(run_);
            run_ = {run_.first + run_.count, 0, 0};
        }
    }
    SortedByBlocks<BlockRun> runs_;
    BlockRun run_;
};

}  // namespace isonest::detail
