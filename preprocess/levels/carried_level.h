// One level of a block whose centres go on to the coarser levels.
#pragma once

#include <algorithm>
#include <cstdint>

#include "preprocess/indicators/layer.h"
#include "preprocess/levels/level_block.h"
#include "preprocess/levels/level_sink.h"
#include "preprocess/levels/pass_context.h"
#include "store/container/format.h"

namespace isonest::detail {

/// What run_level() needs but for the fields. `box` is borrowed.
template <class T>
LevelTask<T> level_task(const StoreLayout& layout, int level, const LayerRange& range,
                        const ValueBox<T>& box) {
    LevelTask<T> task;
    task.range = range;
    task.values = &box;
    task.step = level == 1 ? 1 : 2;
    task.level = level;
    task.spacing = layout.header().spacing;
    task.flat = layout.lattice().flat_axes();
    task.fine_cells = layout.lattice().cells_at(std::max(level - 2, 0));
    return task;
}

/// Runs one level of a block of `count` cubes per axis into `sink`, and hands its centres to the
/// coarser levels.
template <class T>
void run_and_carry(const PassContext& context, const LevelTask<T>& task, int level,
                   const Int3& count, LevelSink& sink);

}  // namespace isonest::detail
