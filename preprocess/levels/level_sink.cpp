#include "preprocess/levels/level_sink.h"

#include "preprocess/levels/pass_context.h"

namespace isonest::detail {

LevelSink::LevelSink(const StoreLayout& layout, int level, const Int3& first, const Int3& count) {
    for (const Field field : layout.header().fields) {
        const ArrayInfo* const array = find_array(layout, level, field);
        if (array == nullptr || array->alias) {
            continue;
        }
        parts_.emplace_back(level == 1 ? source_at_level_1(field) : field,
                            IndicatorChunks(*array, first, count, layout.header().exact));
    }
}

LevelSink LevelSink::of_nodes(const StoreLayout& layout, int level, const Int3& lo,
                              const Int3& count) {
    LevelSink made;
    for (const Field field : layout.header().fields) {
        const ArrayInfo& array = layout.array(level, field);
        if (!array.alias) {
            made.parts_.emplace_back(
                level == 1 ? source_at_level_1(field) : field,
                IndicatorChunks::of_nodes(array, lo, count, layout.header().exact));
        }
    }
    return made;
}

void LevelSink::encode(std::vector<EncodedChunk>& out) const {
    for (const auto& part : parts_) {
        part.second.encode(out);
    }
}

}  // namespace isonest::detail
