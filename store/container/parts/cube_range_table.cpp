#include "store/container/parts/cube_range_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <mutex>
#include <string>
#include <utility>

#include <isonest/error.h>

#include "store/base/label_text.h"
#include "store/bytes/store_bytes.h"
#include "store/container/codec.h"

namespace isonest::detail {

CubeRangeTable::CubeRangeTable(const Catalogue& catalogue, const StoreLayout& layout,
                               const StoreBytes& bytes)
    : bytes_(&bytes), type_(cube_range_type(layout.header().type)) {
    for (int level = kFirstRangeLevel; layout.has_cube_ranges(level); ++level) {
        std::optional<std::uint64_t> offset;
        HeldBytes sums;
        for (const CatalogueRanges& ranges : catalogue.ranges) {
            if (ranges.level == level && lies_within(ranges.offset, ranges.bytes, bytes.size()) &&
                ranges.bytes ==
                    static_cast<std::uint64_t>(layout.lattice().cells_at(level).product()) *
                        cube_range_bytes(layout.header().type)) {
                offset = ranges.offset;
                sums = HeldBytes(nullptr, ranges.sums);
            }
        }
        add(layout, level, offset, std::move(sums));
    }
}

void CubeRangeTable::add(const StoreLayout& layout, int level, std::optional<std::uint64_t> offset,
                         HeldBytes sums) {
    Level l;
    l.cells = layout.lattice().cells_at(level);
    l.plane_bytes =
        static_cast<std::uint64_t>(l.cells.x * l.cells.y) * cube_range_bytes(layout.header().type);
    const auto planes = static_cast<std::size_t>(l.cells.z);
    if (!offset || sums.bytes().size() != planes * sizeof(std::uint64_t)) {
        throw Error(ErrorKind::corrupt, {bytes_->name(), fmt::format("level {}", level)},
                    "the ranges of the cubes are missing or damaged",
                    {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
    }
    l.offset = *offset;
    l.sums = std::move(sums);
    l.seen = std::make_unique<std::atomic<bool>[]>(planes);
    if (!bytes_->is_remote()) {
        l.ranges = bytes_->read(l.offset, l.bytes());
        if (l.bytes() <= kMaxRemote) {
            // Without this hint, the system would read far more than a missing page.
            const ByteRange all{l.offset, l.bytes()};
            bytes_->want({&all, 1});
        }
    } else {
        l.is_read = l.bytes() <= kMaxRemote;
        read_ = std::make_unique<std::once_flag>();
    }
    levels_.push_back(std::move(l));
}

void CubeRangeTable::read_remote() const {
    std::vector<ByteRange> wanted;
    for (const Level& l : levels_) {
        if (l.is_read) {
            wanted.push_back({l.offset, l.bytes()});
        }
    }
    bytes_->want(wanted);
    for (std::size_t i = 0; i < levels_.size(); ++i) {
        Level& l = levels_[i];
        if (!l.is_read) {
            continue;
        }
        const int level = kFirstRangeLevel + static_cast<int>(i);
        auto copy = std::make_shared<std::vector<std::byte>>();
        copy->reserve(l.bytes());
        for (std::int64_t z = 0; z < l.cells.z; ++z) {
            const HeldBytes plane = read_plane(l, level, z);
            copy->insert(copy->end(), plane.bytes().begin(), plane.bytes().end());
        }
        l.ranges = HeldBytes(copy, *copy);
    }
}

HeldBytes CubeRangeTable::read_plane(const Level& l, int level, std::int64_t z) const {
    auto held = read_whole(*bytes_, l.plane(z), sum_of(l, z));
    if (!held) {
        fail_plane(level, z);
    }
    return std::move(*held);
}

std::vector<CubeRange> CubeRangeTable::plane(int level, std::int64_t z) const {
    const Level& l = levels_.at(static_cast<std::size_t>(level - kFirstRangeLevel));
    const HeldBytes held = read_plane(l, level, z);
    std::vector<CubeRange> ranges;
    ranges.reserve(static_cast<std::size_t>(l.cells.x * l.cells.y));
    for (std::int64_t i = 0; i < l.cells.x * l.cells.y; ++i) {
        ranges.push_back(range_in(held.bytes(), i));
    }
    return ranges;
}

void CubeRangeTable::want(int level) const {
    if (!bytes_->is_remote()) {
        return;
    }
    const Level& l = levels_.at(static_cast<std::size_t>(level - kFirstRangeLevel));
    std::vector<ByteRange> planes;
    planes.reserve(static_cast<std::size_t>(l.cells.z));
    for (std::int64_t z = 0; z < l.cells.z; ++z) {
        planes.push_back(l.plane(z));
    }
    bytes_->want(planes);
}

CubeRange CubeRangeTable::range_in(std::span<const std::byte> bytes, std::int64_t cube) const {
    return dispatch(type_, [&](auto tag) {
        using T = typename decltype(tag)::type;
        std::array<T, 2> both{};
        std::memcpy(both.data(), bytes.data() + static_cast<std::size_t>(cube) * sizeof(both),
                    sizeof(both));
        return CubeRange{static_cast<float>(both[0]), static_cast<float>(both[1])};
    });
}

std::optional<CubeRange> CubeRangeTable::at(int level, const Int3& cube) const {
    const auto index = static_cast<std::size_t>(level - kFirstRangeLevel);
    if (level < kFirstRangeLevel || index >= levels_.size()) {
        return std::nullopt;
    }
    const Level& l = levels_[index];
    if (!l.is_read) {
        return std::nullopt;
    }
    if (min(cube, {0, 0, 0}) != Int3{0, 0, 0} || max(cube + Int3{1, 1, 1}, l.cells) != l.cells) {
        return std::nullopt;
    }
    if (read_ != nullptr) {
        std::call_once(*read_, [&] { read_remote(); });
    }
    require_whole(l, level, cube.z);
    return range_in(l.ranges.bytes(), l.cells.linear(cube));
}

std::uint64_t CubeRangeTable::sum_of(const Level& l, std::int64_t z) {
    std::uint64_t sum = 0;
    std::memcpy(&sum, l.sums.bytes().data() + static_cast<std::size_t>(z) * sizeof(sum),
                sizeof(sum));
    return sum;
}

void CubeRangeTable::fail_plane(int level, std::int64_t z) const {
    throw Error(ErrorKind::corrupt,
                {bytes_->name(), fmt::format("level {}, ranges of the cubes, plane {}", level, z)},
                "checksum mismatch: the bytes have changed",
                {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
}

void CubeRangeTable::require_whole(const Level& l, int level, std::int64_t z) const {
    const auto plane = static_cast<std::size_t>(z);
    if (l.seen[plane].load(std::memory_order_relaxed)) {
        return;
    }
    if (checksum_of(l.ranges.bytes().subspan(plane * l.plane_bytes, l.plane_bytes)) !=
        sum_of(l, z)) {
        fail_plane(level, z);
    }
    l.seen[plane].store(true, std::memory_order_relaxed);
}

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
    if (place.rows < 1 || place.rows > LabelName::kMaxOfStore ||
        place.row_bytes <= LabelRow::kName ||
        place.row_bytes > LabelRow::kName + LabelName::kMaxBytes ||
        !lies_within(place.offset, place.rows * place.row_bytes, bytes.size())) {
        names_damaged(name, kOtherNamesForm);
    }
    auto held = read_whole(bytes, {place.offset, place.rows * place.row_bytes}, place.xxh64);
    if (!held) {
        names_damaged(name, "checksum mismatch: its bytes have changed");
    }
    held_ = std::move(*held);
    std::int64_t before = 0;
    for (std::size_t i = 0; i < size(); ++i) {
        const LabelName label = at(i);
        const std::string why = why_no_label_names({&label, 1});
        if (!why.empty() || (i > 0 && label.id <= before) ||
            label.name.find('\0') != std::string::npos) {
            names_damaged(name, why.empty() ? "the ids of its rows are not increasing" : why);
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
