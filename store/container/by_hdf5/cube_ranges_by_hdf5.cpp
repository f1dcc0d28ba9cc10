#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "store/base/checksum.h"
#include "store/container/cube_range_table.h"
#include "store/container/hdf5_types.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

CubeRangeTable::CubeRangeTable(std::int64_t file, const StoreLayout& layout,
                               const StoreBytes& bytes)
    : bytes_(&bytes), type_(cube_range_type(layout.header().type)) {
    for (int level = kFirstRangeLevel; layout.has_cube_ranges(level); ++level) {
        const auto open = [&](const std::string& path) {
            return DatasetHandle(H5Dopen2(file, path.c_str(), H5P_DEFAULT));
        };
        const DatasetHandle ranges = open(StoreLayout::cube_ranges_path(level));
        const DatasetHandle sums = open(StoreLayout::cube_range_sums_path(level));
        const Int3 cells = layout.lattice().cells_at(level);
        const std::uint64_t sum_bytes = static_cast<std::uint64_t>(cells.z) * sizeof(std::uint64_t);
        std::optional<std::uint64_t> offset;
        HeldBytes held;
        if (ranges.valid() && sums.valid()) {
            const auto sums_at = offset_of(sums.get(), sum_bytes, bytes.size());
            const auto sum = read_integers(sums.get(), "xxh64", 1);
            if (sums_at) {
                held = bytes.read(*sums_at, sum_bytes);
            }
            if (sum && checksum_of(held.bytes()) == (*sum)[0]) {
                offset = offset_of(ranges.get(),
                                   static_cast<std::uint64_t>(cells.product()) *
                                       cube_range_bytes(layout.header().type),
                                   bytes.size());
            }
        }
        add(layout, level, offset, std::move(held));
    }
}

}  // namespace isonest::detail
