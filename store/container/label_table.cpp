#include "store/container/label_table.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include <isonest/error.h>

#include "store/base/label_text.h"
#include "store/bytes/read_whole.h"
#include "store/container/codec.h"

namespace isonest::detail {
namespace {

constexpr std::byte kHasColor{1};

}  // namespace

void names_damaged(const std::string& store, const std::string& problem) {
    throw Error(ErrorKind::corrupt, {store, "names of labels"}, "damaged: " + problem,
                {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
}

LabelTable::LabelTable(const CatalogueNames& place, const StoreBytes& bytes)
    : row_bytes_(place.row_bytes) {
    const std::string& name = bytes.name();
    if (place.rows < 1 || place.rows > LabelName::kMostOfStore ||
        place.row_bytes <= LabelRow::kName ||
        place.row_bytes > LabelRow::kName + LabelName::kMostBytes ||
        !lies_within(place.offset, place.rows * place.row_bytes, bytes.size())) {
        names_damaged(name, kOtherNamesForm);
    }
    auto held = read_whole(bytes, {place.offset, place.rows * place.row_bytes}, place.xxh64);
    if (!held) {
        names_damaged(name, "its bytes are not those that were written");
    }
    held_ = std::move(*held);
    std::int64_t before = 0;
    for (std::size_t i = 0; i < size(); ++i) {
        const LabelName label = at(i);
        const std::string why = why_no_label_names({&label, 1});
        if (!why.empty() || (i > 0 && label.id <= before) ||
            label.name.find('\0') != std::string::npos) {
            names_damaged(name, why.empty() ? "its rows are not by rising ids" : why);
        }
        before = label.id;
    }
}

std::size_t LabelTable::size() const {
    return rows().size() / row_bytes_;
}

std::int64_t LabelTable::id_at(std::size_t i) const {
    std::int64_t id = 0;
    std::memcpy(&id, rows().data() + i * row_bytes_, sizeof(id));
    return id;
}

LabelName LabelTable::at(std::size_t i) const {
    const std::byte* const row = rows().data() + i * row_bytes_;
    LabelName label;
    label.id = id_at(i);
    if ((row[LabelRow::kFlags] & kHasColor) != std::byte{0}) {
        std::memcpy(label.color.emplace().data(), row + LabelRow::kColor,
                    std::tuple_size_v<LabelColor>);
    }
    label.name.assign(reinterpret_cast<const char*>(row) + LabelRow::kName,
                      row_bytes_ - LabelRow::kName);
    label.name.resize(label.name.find_last_not_of('\0') + 1);
    return label;
}

std::optional<LabelName> LabelTable::find(std::int64_t id) const {
    std::size_t first = 0;
    for (std::size_t count = size(); count > 0;) {
        const std::size_t half = count / 2;
        if (id_at(first + half) < id) {
            first += half + 1;
            count -= half + 1;
        } else {
            count = half;
        }
    }
    return first < size() && id_at(first) == id ? std::optional(at(first)) : std::nullopt;
}

std::size_t name_bytes_of(std::span<const LabelName> names) {
    std::size_t bytes = 1;
    for (const LabelName& label : names) {
        bytes = std::max(bytes, label.name.size());
    }
    return bytes;
}

std::vector<std::byte> label_rows(std::span<const LabelName> names, std::size_t name_bytes) {
    std::vector<std::byte> rows(names.size() * (LabelRow::kName + name_bytes));
    std::byte* row = rows.data();
    for (const LabelName& label : names) {
        std::memcpy(row, &label.id, sizeof(label.id));
        if (label.color) {
            row[LabelRow::kFlags] = kHasColor;
            std::memcpy(row + LabelRow::kColor, label.color->data(), label.color->size());
        }
        std::memcpy(row + LabelRow::kName, label.name.data(), label.name.size());
        row += LabelRow::kName + name_bytes;
    }
    return rows;
}

}  // namespace isonest::detail
