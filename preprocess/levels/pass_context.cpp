#include "preprocess/levels/pass_context.h"

#include <algorithm>

namespace isonest::detail {

const ArrayInfo* find_array(const StoreLayout& layout, int level, Field field) {
    return level <= layout.lattice().top() && layout.has(field) ? &layout.array(level, field)
                                                                : nullptr;
}

LayerRange range_of(const StoreLayout& layout, int level, const Int3& first, const Int3& count) {
    const Int3 cells = layout.lattice().cells_at(level);
    return {first, min(first + count, cells), cells};
}

Field deviation_carried(const StoreLayout& layout) {
    return layout.has(Field::deviation_bar) ? Field::deviation_bar : Field::deviation_plus;
}

std::vector<Field> fields_at(const StoreLayout& layout, int level) {
    std::vector<Field> fields = layout.header().fields;
    if (level == 1) {
        std::transform(fields.begin(), fields.end(), fields.begin(), source_at_level_1);
        std::sort(fields.begin(), fields.end());
        fields.erase(std::unique(fields.begin(), fields.end()), fields.end());
    }
    return fields;
}

}  // namespace isonest::detail
