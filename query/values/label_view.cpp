#include "query/values/label_view.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include <isonest/error.h>
#include <isonest/value_type.h>

#include "store/base/label_text.h"
#include "store/container/reader.h"

namespace isonest::detail {

bool is_label(const StoreHeader& header, std::int64_t label) {
    if (header.labels) {
        return label >= 0 && static_cast<std::uint64_t>(label) <= kMaxLabel;
    }
    return dispatch(header.type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        const auto id = static_cast<double>(label);
        return id >= static_cast<double>(std::numeric_limits<T>::lowest()) &&
               id <= static_cast<double>(std::numeric_limits<T>::max());
    });
}

double value_of_label(const StoreHeader& header, std::int64_t label) {
    return header.labels ? value_of_label(static_cast<std::uint64_t>(label))
                         : static_cast<double>(label);
}

std::optional<std::int64_t> wide_label(const StoreHeader& header, double value) {
    return header.labels && std::isfinite(value)
               ? std::optional(static_cast<std::int64_t>(label_of_value(value)))
               : std::nullopt;
}

std::string_view type_of_values(const StoreHeader& header) {
    return header.labels ? std::string_view("int64") : name_of(header.type);
}

void require_numbers(const StoreReader& store, std::string_view what) {
    if (store.layout().header().labels) {
        throw Error(ErrorKind::unsupported, {store.path().string()},
                    fmt::format("its values are 64-bit labels, and {} would treat them as "
                                "quantities; export the values, which are written as int64, or "
                                "extract the surfaces of labels",
                                what));
    }
}

LabelView::LabelView(const ChunkSource& source, std::int64_t label, const Int3& low,
                     const Int3& high)
    : ForwardingSource(source),
      value_(value_of_label(source.layout().header(), label)),
      low_(low),
      high_(high) {}

ChunkRow LabelView::row(const ArrayInfo& array, const Int3& chunk) const {
    ChunkRow row = source().row(array, chunk);
    const Int3 first = array.first_node(chunk);
    const Int3 last = min(first + array.chunk, array.nodes) - Int3{1, 1, 1};
    const bool apart = max(first, low_) != min(max(first, low_), min(last, high_));
    if (apart || !(row.min <= value_ && value_ <= row.max)) {
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
    source().decode(array, chunk, raw);
    dispatch(layout().header().type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        T* const values = reinterpret_cast<T*>(raw.data());
        const auto label = static_cast<T>(value_);
        for (std::size_t i = 0; i < raw.size() / sizeof(T); ++i) {
            values[i] = values[i] == label ? T{1} : T{0};
        }
    });
}

}  // namespace isonest::detail
