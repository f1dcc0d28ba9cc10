// A sequence of things that lie in blocks of space, in temporary files.
#pragma once

#include <cstdint>
#include <span>

#include "query/simplify/block_runs.h"
#include "query/simplify/growing_file.h"
#include "store/files/scratch_file.h"

namespace isonest::detail {

/// Things stay in the order in which they came; runs of them say which are a block's. Not
/// thread-safe; constant once it is sorted, but for consume().
template <class T>
class BlockItems {
  public:
    explicit BlockItems(const ScratchFolder& folder) : items_(folder), runs_(folder) {}

    void append(const T& item) { items_.append(item); }
    void append(const T& item, std::uint32_t block) {
        items_.append(item);
        runs_.add(block);
    }
    /// After the last append(). Throws Error{io}.
    void seal() { items_.seal(); }
    /// For those that were appended without one, in their order. REQUIRES: seal() was called.
    void add_block(std::uint32_t block) { runs_.add(block); }
    /// REQUIRES: seal() was called, each has a block. Throws Error{io}.
    void sort(std::uint32_t blocks) { runs_.sort(blocks); }

    [[nodiscard]] std::uint64_t count() const { return items_.size(); }
    /// In their order. REQUIRES: seal() was called.
    [[nodiscard]] std::span<const T> all() const { return items_.all(); }
    /// visit(item) for those of a block, in their order. REQUIRES: sort() was called.
    template <class Visit>
    void each(std::uint32_t block, const Visit& visit) const {
        for (const BlockRun& run : runs_.of(block)) {
            for (const T& item : all().subspan(run.first, run.count)) {
                visit(item);
            }
        }
    }
    [[nodiscard]] std::uint64_t count_in(std::uint32_t block) const {
        std::uint64_t count = 0;
        for (const BlockRun& run : runs_.of(block)) {
            count += run.count;
        }
        return count;
    }
    /// Nobody will look at those of a block any more: their space is given back, sooner or later.
    /// REQUIRES: sort() was called; of each block once. May be called while other threads look at
    /// other blocks.
    void consume(std::uint32_t block) {
        for (const BlockRun& run : runs_.of(block)) {
            items_.release(run.first, run.count);
        }
    }

  private:
    GrowingFile<T> items_;
    BlockRuns runs_;
};

}  // namespace isonest::detail
