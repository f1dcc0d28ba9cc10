// How a preprocessing run shares its memory.
#pragma once

#include <cstdint>

#include <isonest/preprocess.h>
#include <isonest/volume_source.h>

#include "store/container/format.h"

namespace isonest::detail {

/// What one block under way holds at most, in bytes. K: nodes per axis of a chunk. The formulas are
/// in pass_budget.cpp; tests/program/memory_test.py compares the sum of all with the heap of whole
/// runs.
struct BlockHeap {
    std::uint64_t values = 0;  ///< the box of values that it reads, with a margin
    /// Beside that box: the encoded chunks of values (a base block), or the finer deviations (a
    /// coarser one), whichever is more.
    std::uint64_t beside_values = 0;
    std::uint64_t indicator_chunks = 0;  ///< of the levels that it makes, raw and encoded
    std::uint64_t centres = 0;           ///< of all fields, from the finer level
    std::uint64_t layers = 0;            ///< two per field, which saturation works on
    std::uint64_t planes = 0;            ///< what the indicators' kernels hold of the values
    std::uint64_t codec = 0;             ///< zstd's context and its buffers

    [[nodiscard]] std::uint64_t total() const {
        return values + beside_values + indicator_chunks + centres + layers + planes + codec;
    }
};
BlockHeap block_heap(const StoreLayout& layout);

/// The shares of a run's memory, in bytes. What they do not cover grows with nothing.
struct PassBudget {
    std::uint64_t fixed = 0;   ///< the libraries' own heap, and the source's
    int tokens = 1;            ///< blocks under way at a time: at most one more than threads
    std::uint64_t blocks = 0;  ///< what those take: up to three fifths of what is not fixed
    std::uint64_t rest = 0;    ///< for the window over the input, and then for the chunk cache

    /// Of the cache of finer chunks that coarser levels are made from, given what the window takes.
    [[nodiscard]] std::uint64_t cache(std::uint64_t window) const;
};
/// Throws Error{limit} if `options.memory` is not enough for one block.
PassBudget share_memory(const StoreLayout& layout, const VolumeSource& source,
                        const PreprocessOptions& options, int threads);

}  // namespace isonest::detail
