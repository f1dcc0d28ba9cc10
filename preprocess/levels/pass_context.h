// What all blocks of the bottom-up pass share.
#pragma once

#include <cstdint>
#include <vector>

#include <isonest/field.h>
#include <isonest/int3.h>
#include <isonest/preprocess.h>
#include <isonest/volume_source.h>

#include "preprocess/indicators/layer.h"
#include "preprocess/indicators/own_indicators.h"
#include "preprocess/levels/centre_store.h"
#include "store/container/format.h"

namespace isonest::detail {

// How a preprocessing run divides its memory.

/// Maximum bytes held by one block under way. K: nodes per axis of a chunk. The formulas are in
/// pass_context.cpp; tests/program/memory_test.py compares the sum with the heap of whole runs.
struct BlockHeap {
    std::uint64_t values = 0;  ///< the box of values that it reads, including a margin
    /// In addition to that box: the encoded chunks of values (a base block), or the finer
    /// deviations (a coarser block), whichever is larger.
    std::uint64_t beside_values = 0;
    std::uint64_t indicator_chunks = 0;  ///< of the levels that it produces, raw and encoded
    std::uint64_t centres = 0;           ///< of all fields, from the finer level
    std::uint64_t layers = 0;            ///< two per field, for saturation
    std::uint64_t planes = 0;            ///< values held by the kernels of the indicators
    std::uint64_t codec = 0;             ///< zstd's context and buffers

    [[nodiscard]] std::uint64_t total() const {
        return values + beside_values + indicator_chunks + centres + layers + planes + codec;
    }
};
BlockHeap block_heap(const StoreLayout& layout);

/// The shares of a run's memory in bytes. Memory that they do not cover does not grow with the
/// input.
struct PassBudget {
    std::uint64_t fixed = 0;   ///< heap of the libraries and of the source
    int tokens = 1;            ///< number of blocks under way: at most one more than threads
    std::uint64_t blocks = 0;  ///< memory of those blocks: at most three fifths of what is not
                               ///< fixed
    std::uint64_t rest = 0;    ///< for the window over the input, then for the chunk cache

    /// Share of the cache of finer chunks from which coarser levels are made, given the memory of
    /// the window.
    [[nodiscard]] std::uint64_t cache(std::uint64_t window) const;
};
/// Throws Error{limit} if `options.memory` is not enough for one block.
PassBudget share_memory(const StoreLayout& layout, const VolumeSource& source,
                        const PreprocessOptions& options, int threads);

/// Read-only while blocks run, except for `centres` (disjoint boxes).
struct PassContext {
    const StoreLayout& layout;
    CentreStore& centres;
    const OwnIndicators* own = nullptr;  ///< null if there are none
};

/// Nodes that a block needs beyond its own: two for the deviation of level 2 of a base block, and
/// one more for missing values next to the finer cubes that its edges depend on.
inline constexpr std::int64_t kMargin = 3;
/// The same for a block of a level >= 3, in nodes two levels finer: needed for the deviation.
inline constexpr std::int64_t kCoarseMargin = 2;

/// Null if the store has no such array.
const ArrayInfo* find_array(const StoreLayout& layout, int level, Field field);

/// `count` cubes of the level per axis, starting at `first`, as far as they exist.
LayerRange range_of(const StoreLayout& layout, int level, const Int3& first, const Int3& count);

/// The field that carries the maximum distance between the finest function and a finer level's.
/// REQUIRES: a deviation field is stored.
Field deviation_carried(const StoreLayout& layout);

/// The fields to compute at a level, without repetition.
std::vector<Field> fields_at(const StoreLayout& layout, int level);

}  // namespace isonest::detail
