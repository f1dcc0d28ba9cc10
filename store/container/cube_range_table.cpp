#include "store/container/cube_range_table.h"

#include <fmt/format.h>

#include <array>
#include <cstring>
#include <mutex>
#include <string>
#include <utility>

#include <isonest/error.h>

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
    if (!bytes_->is_far()) {
        l.ranges = bytes_->read(l.offset, l.bytes());
    } else {
        l.is_read = l.bytes() <= kMostFar;
        read_ = std::make_unique<std::once_flag>();
    }
    levels_.push_back(std::move(l));
}

void CubeRangeTable::read_far() const {
    std::vector<ByteRange> wanted;
    for (const Level& l : levels_) {
        if (l.is_read) {
            wanted.push_back({l.offset, l.bytes()});
        }
    }
    bytes_->want(wanted);
    for (Level& l : levels_) {
        if (l.is_read) {
            const HeldBytes held = bytes_->read(l.offset, l.bytes());
            auto copy =
                std::make_shared<std::vector<std::byte>>(held.bytes().begin(), held.bytes().end());
            l.ranges = HeldBytes(copy, *copy);
        }
    }
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
        std::call_once(*read_, [&] { read_far(); });
    }
    require_whole(l, level, cube.z);
    return dispatch(type_, [&](auto tag) {
        using T = typename decltype(tag)::type;
        std::array<T, 2> both{};
        std::memcpy(
            both.data(),
            l.ranges.bytes().data() + static_cast<std::size_t>(l.cells.linear(cube)) * sizeof(both),
            sizeof(both));
        return CubeRange{static_cast<float>(both[0]), static_cast<float>(both[1])};
    });
}

void CubeRangeTable::require_whole(const Level& l, int level, std::int64_t z) const {
    const auto plane = static_cast<std::size_t>(z);
    if (l.seen[plane].load(std::memory_order_relaxed)) {
        return;
    }
    std::uint64_t sum = 0;
    std::memcpy(&sum, l.sums.bytes().data() + plane * sizeof(sum), sizeof(sum));
    if (checksum_of(l.ranges.bytes().subspan(plane * l.plane_bytes, l.plane_bytes)) != sum) {
        throw Error(
            ErrorKind::corrupt,
            {bytes_->name(), fmt::format("level {}, ranges of the cubes, plane {}", level, z)},
            "the bytes are not those that were written",
            {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
    }
    l.seen[plane].store(true, std::memory_order_relaxed);
}

}  // namespace isonest::detail
