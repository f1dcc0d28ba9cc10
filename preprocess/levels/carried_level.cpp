#include "preprocess/levels/carried_level.h"

#include <algorithm>
#include <cstddef>
#include <vector>

#include <isonest/field.h>
#include <isonest/value_type.h>

#include "store/base/box.h"

namespace isonest::detail {
namespace {

/// Cubes of the level inside a block, for the centres that the block hands on.
Box<float> own_cubes(const LayerRange& range, const Int3& count) {
    const Int3 end = min(range.lo + count, max(range.cells, {1, 1, 1}));
    return {range.lo, max(end - range.lo, {0, 0, 0})};
}

}  // namespace

template <class T>
void run_and_carry(const PassContext& context, const LevelTask<T>& task, int level,
                   const Int3& count, LevelSink& sink) {
    const bool carry = level < context.layout.lattice().top();
    const int centre = context.layout.lattice().centre_slot();
    std::vector<Box<float>> centres(carry ? task.fields.size() : 0, own_cubes(task.range, count));
    run_level(task, [&](Field field, std::int64_t k, const auto& layer) {
        sink.put(field, task.range, k, layer);
        for (std::size_t f = 0; f < centres.size(); ++f) {
            if (task.fields[f].field == field) {
                keep_centres(centre, task.range, k, layer, centres[f]);
            }
        }
    });
    for (std::size_t f = 0; f < centres.size(); ++f) {
        context.centres.put(level, task.fields[f].field, centres[f]);
    }
}

// NOLINTBEGIN(bugprone-macro-parentheses): T is a type
#define ISONEST_INSTANTIATE(tag, T)                                                        \
    template void run_and_carry(const PassContext&, const LevelTask<T>&, int, const Int3&, \
                                LevelSink&);
ISONEST_FOR_EACH_VALUE_TYPE(ISONEST_INSTANTIATE)
#undef ISONEST_INSTANTIATE
// NOLINTEND(bugprone-macro-parentheses)

}  // namespace isonest::detail
