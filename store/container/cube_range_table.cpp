#include "store/container/cube_range_table.h"

#include <fmt/format.h>

#include <array>
#include <cstring>
#include <string>
#include <utility>

#include <isonest/error.h>

#include "store/container/hdf5_types.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {
CubeRangeTable::CubeRangeTable(std::int64_t file, const StoreLayout& layout,
                               std::span<const std::byte> bytes, std::string name)
    : name_(std::move(name)), type_(cube_range_type(layout.header().type)) {
    for (int level = kFirstRangeLevel; layout.has_cube_ranges(level); ++level) {
        const auto open = [&](const std::string& path) {
            return DatasetHandle(H5Dopen2(file, path.c_str(), H5P_DEFAULT));
        };
        const DatasetHandle ranges = open(StoreLayout::cube_ranges_path(level));
        const DatasetHandle sums = open(StoreLayout::cube_range_sums_path(level));
        Level l;
        l.cells = layout.lattice().cells_at(level);
        l.plane_bytes = static_cast<std::size_t>(l.cells.x * l.cells.y) *
                        cube_range_bytes(layout.header().type);
        const auto planes = static_cast<std::size_t>(l.cells.z);
        std::optional<std::vector<std::uint64_t>> sum;
        if (ranges.valid() && sums.valid()) {
            l.ranges = contiguous(ranges.get(), planes * l.plane_bytes, bytes);
            l.sums = contiguous(sums.get(), planes * sizeof(std::uint64_t), bytes);
            sum = read_integers(sums.get(), "xxh64", 1);
        }
        if (l.ranges.empty() || l.sums.empty() || !sum || checksum_of(l.sums) != (*sum)[0]) {
            throw Error(ErrorKind::corrupt, {name_, fmt::format("level {}", level)},
                        "the ranges of the cubes are missing or damaged",
                        {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
        }
        l.seen = std::make_unique<std::atomic<bool>[]>(planes);
        levels_.push_back(std::move(l));
    }
}

std::optional<CubeRange> CubeRangeTable::at(int level, const Int3& cube) const {
    const auto index = static_cast<std::size_t>(level - kFirstRangeLevel);
    if (level < kFirstRangeLevel || index >= levels_.size()) {
        return std::nullopt;
    }
    const Level& l = levels_[index];
    if (min(cube, {0, 0, 0}) != Int3{0, 0, 0} || max(cube + Int3{1, 1, 1}, l.cells) != l.cells) {
        return std::nullopt;
    }
    require_whole(l, level, cube.z);
    return dispatch(type_, [&](auto tag) {
        using T = typename decltype(tag)::type;
        std::array<T, 2> both{};
        std::memcpy(both.data(),
                    l.ranges.data() + static_cast<std::size_t>(l.cells.linear(cube)) * sizeof(both),
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
    std::memcpy(&sum, l.sums.data() + plane * sizeof(sum), sizeof(sum));
    if (checksum_of(l.ranges.subspan(plane * l.plane_bytes, l.plane_bytes)) != sum) {
        throw Error(ErrorKind::corrupt,
                    {name_, fmt::format("level {}, ranges of the cubes, plane {}", level, z)},
                    "the bytes are not those that were written",
                    {{RemedyKind::good_copy}, {RemedyKind::preprocess_again}});
    }
    l.seen[plane].store(true, std::memory_order_relaxed);
}

}  // namespace isonest::detail
