// The blocks that read the volume and produce the levels.
#pragma once

#include <oneapi/tbb/task_group.h>

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include <isonest/int3.h>

#include "preprocess/indicators/layer.h"
#include "preprocess/levels/level_block.h"
#include "preprocess/levels/level_sink.h"
#include "preprocess/levels/pass_context.h"
#include "preprocess/sources/wrapping/plane_window.h"
#include "store/container/chunk_cache.h"
#include "store/container/format.h"

namespace isonest::detail {

// The input of a level's blocks from the levels below.

/// Thread-safety: chunk() from any thread.
class FinerLevels {
  public:
    FinerLevels() = default;
    FinerLevels(const FinerLevels&) = delete;
    FinerLevels& operator=(const FinerLevels&) = delete;
    virtual ~FinerLevels() = default;
    /// The nodes of a chunk of values, or of the deviations of level 1; their stride along x is 1.
    /// Nodes that the current block does not need are undefined. Throws Error{io, corrupt}.
    virtual ChunkNodes chunk(const ArrayInfo& array, const Int3& chunk) = 0;
};

/// Reads from a store that is being written, through a cache of `bytes`.
class CachedLevels : public FinerLevels {
  public:
    CachedLevels(const ChunkSource& store, std::uint64_t bytes) : cache_(store, bytes) {}
    ChunkNodes chunk(const ArrayInfo& array, const Int3& chunk) override {
        return {cache_.get(array, chunk), {1, array.chunk.x, array.chunk.x * array.chunk.y}};
    }

  private:
    ChunkCache cache_;
};

// One level of a block whose centres are passed to the coarser levels.

/// The input of run_level() except the fields. `box` is borrowed.
template <class T>
LevelTask<T> level_task(const PassContext& context, int level, const LayerRange& range,
                        const ValueBox<T>& box) {
    const StoreLayout& layout = context.layout;
    LevelTask<T> task;
    task.own = context.own;
    task.range = range;
    task.values = &box;
    task.step = level == 1 ? 1 : 2;
    task.level = level;
    task.steps = layout.header().steps();
    task.flat = layout.lattice().flat_axes();
    task.fine_cells = layout.lattice().cells_at(std::max(level - 2, 0));
    return task;
}

/// Runs one level of a block of `count` cubes per axis into `sink`, and passes its centres to the
/// coarser levels.
template <class T>
void run_and_carry(const PassContext& context, const LevelTask<T>& task, int level,
                   const Int3& count, LevelSink& sink);

// The blocks that read the volume and produce levels 0 to 2.

/// Number of base blocks per axis; block c covers nodes 2K c to 2K (c + 1) - 1, where K is the
/// chunk size.
Int3 base_grid(const StoreLayout& layout);
/// Planes of the volume that the blocks with this z need: [first, second).
std::pair<std::int64_t, std::int64_t> base_planes(const StoreLayout& layout, std::int64_t z);
/// Calls work() while another thread calls read(). Throws what work() throws, else what read()
/// throws, when both have ended.
template <class Read, class Work>
void while_reading(const Read& read, const Work& work) {
    tbb::task_group reading;
    reading.run(read);
    try {
        work();
    } catch (...) {
        try {
            reading.wait();
        } catch (...) {
            // The first failure is the one to report.
        }
        throw;
    }
    reading.wait();
}
/// Levels 0 to 2 of one base block: values of 0 and 1, indicators of 1 and 2.
template <class T>
std::vector<EncodedChunk> base_block(const PassContext& context, const PlaneWindow& window,
                                     const Int3& block);

// The blocks that produce a level from those below.

/// Number of blocks per axis of the pass that makes level `level` >= 3.
Int3 coarse_grid(const StoreLayout& layout, int level);
/// The values two levels finer that are needed for `count` cubes of a level per axis, starting at
/// `first`, as far as cubes exist.
template <class T>
ValueBox<T> coarse_values(const StoreLayout& layout, FinerLevels& finer, int level,
                          const Int3& first, const Int3& count);
/// Writes the indicators of these cubes' nodes to `sink`, and passes their centres to the coarser
/// levels. `box`: from coarse_values().
template <class T>
void coarse_indicators(const PassContext& context, FinerLevels& finer, int level, const Int3& first,
                       const Int3& count, const ValueBox<T>& box, LevelSink& sink);

/// Values of level - 1 and indicators of `level`; reads values of level - 2 from `finer`.
template <class T>
std::vector<EncodedChunk> coarse_block(const PassContext& context, FinerLevels& finer, int level,
                                       const Int3& block);

/// The values of the coarsest level, from those of the level below.
template <class T>
std::vector<EncodedChunk> top_values(const PassContext& context, FinerLevels& finer);

}  // namespace isonest::detail
