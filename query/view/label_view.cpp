#include "query/view/label_view.h"

#include <isonest/value_type.h>

namespace isonest::detail {

ChunkRow LabelView::row(const ArrayInfo& array, const Int3& chunk) const {
    ChunkRow row = source_.row(array, chunk);
    const Int3 first = array.first_node(chunk);
    const Int3 last = min(first + array.chunk, array.nodes) - Int3{1, 1, 1};
    const auto label = static_cast<double>(label_);
    const bool apart = max(first, low_) != min(max(first, low_), min(last, high_));
    if (apart || !(row.min <= label && label <= row.max)) {
        row.min = row.max = 0;
    } else if (row.min == row.max && row.flags == 0) {
        row.min = row.max = 1;
    } else {
        row.min = 0;
        row.max = 1;
    }
    row.flags = 0;
    return row;
}

void LabelView::decode(const ArrayInfo& array, const Int3& chunk, std::span<std::byte> raw) const {
    source_.decode(array, chunk, raw);
    dispatch(layout().header().type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        T* const values = reinterpret_cast<T*>(raw.data());
        const auto label = static_cast<T>(label_);
        for (std::size_t i = 0; i < raw.size() / sizeof(T); ++i) {
            values[i] = values[i] == label ? T{1} : T{0};
        }
    });
}

}  // namespace isonest::detail
