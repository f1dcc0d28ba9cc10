// What all blocks of the bottom-up pass have in common.
#pragma once

#include <cstdint>
#include <vector>

#include <isonest/field.h>
#include <isonest/int3.h>

#include "preprocess/indicators/layer.h"
#include "preprocess/levels/centre_store.h"
#include "store/container/format.h"

namespace isonest::detail {

/// Read-only while blocks run, but for `centres` (disjoint boxes).
struct PassContext {
    const StoreLayout& layout;
    CentreStore& centres;
};

/// Nodes that a block needs beyond its own: two for the deviation of level 2 of a base block, and
/// one more for missing values beside the finer cubes that its edges look at.
inline constexpr std::int64_t kMargin = 3;
/// The same of a block of a level from 3 on, in nodes two levels finer: those of the deviation.
inline constexpr std::int64_t kCoarseMargin = 2;

/// Null where the store has no such array.
const ArrayInfo* find_array(const StoreLayout& layout, int level, Field field);

/// `count` cubes of the level per axis from `first` on, as far as there are cubes.
LayerRange range_of(const StoreLayout& layout, int level, const Int3& first, const Int3& count);

/// The field that tells how far the finest function can be from a finer level's. REQUIRES: one of
/// the deviation is stored.
Field deviation_carried(const StoreLayout& layout);

/// The fields to compute at a level, none twice.
std::vector<Field> fields_at(const StoreLayout& layout, int level);

}  // namespace isonest::detail
