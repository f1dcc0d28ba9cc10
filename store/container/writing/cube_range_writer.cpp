#include "store/container/writing/cube_range_writer.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include <isonest/value_type.h>

#include "store/container/codec.h"
#include "store/container/hdf5_types.h"

namespace isonest::detail {

namespace {

/// How many are packed and written together.
constexpr std::int64_t kRangesAtOnce = 65536;

/// The ranges as they are stored.
void pack(std::span<const CubeRange> ranges, ValueType type, std::vector<std::byte>& out) {
    dispatch(type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        out.resize(ranges.size() * 2 * sizeof(T));
        std::byte* to = out.data();
        for (const CubeRange& range : ranges) {
            const std::array<T, 2> both{static_cast<T>(range.low), static_cast<T>(range.high)};
            std::memcpy(to, both.data(), sizeof(both));
            to += sizeof(both);
        }
    });
}

}  // namespace

void write_ranges_of_cubes(const WrittenFile& file, const StoreLayout& layout, int level,
                           std::span<const CubeRange> ranges) {
    const ValueType type = cube_range_type(layout.header().type);
    const Int3 cells = layout.lattice().cells_at(level);
    const std::string name = StoreLayout::cube_ranges_path(level);
    const TypeHandle stored = file_type(type);
    const auto dims = dims_of(cells, 2);
    DatasetHandle dataset = file.create_whole(name, stored.get(), dims);
    const std::int64_t most = std::max<std::int64_t>(1, kRangesAtOnce / cells.x);  // rows
    std::vector<std::byte> packed;
    std::vector<std::uint64_t> sums;
    sums.reserve(static_cast<std::size_t>(cells.z));
    for (std::int64_t z = 0; z < cells.z; ++z) {
        Checksum sum;
        for (std::int64_t y = 0; y < cells.y; y += most) {
            const Int3 rows{cells.x, std::min(most, cells.y - y), 1};
            pack(ranges.subspan(static_cast<std::size_t>(cells.linear({0, y, z})),
                                static_cast<std::size_t>(rows.product())),
                 type, packed);
            sum.add(packed);
            const auto at = dims_of({0, y, z}, 0);
            const auto count = dims_of(rows, 2);
            file.write_part(dataset, name, stored.get(), at, count, packed.data());
        }
        sums.push_back(sum.value());
    }
    file.close(std::move(dataset), name);
    const std::array<hsize_t, 1> count{sums.size()};
    const std::string sums_name = StoreLayout::cube_range_sums_path(level);
    DatasetHandle checksums = file.write_whole(sums_name, H5T_STD_U64LE, count, sums.data());
    write_attribute(checksums.get(), "xxh64", checksum_of(std::as_bytes(std::span(sums))));
    file.close(std::move(checksums), sums_name);
}

}  // namespace isonest::detail
