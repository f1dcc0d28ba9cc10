#include "preprocess/levels/resumed_input.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include <isonest/error.h>

#include "store/container/chunk_cache.h"
#include "store/container/gather.h"

namespace isonest::detail {
namespace {

constexpr std::int64_t kMostBytes = std::int64_t{1} << 20U;

template <class T>
void compare_plane(VolumeSource& source, ChunkCache& cache, std::int64_t z) {
    const ArrayInfo& array = cache.source().layout().array(0, Field::values);
    const Int3 n = array.nodes;
    const std::int64_t step = source.granularity().rows;
    const std::int64_t fitting = kMostBytes / (n.x * static_cast<std::int64_t>(sizeof(T)));
    const std::int64_t rows = std::clamp<std::int64_t>(fitting / step * step, 1, n.y);
    for (std::int64_t y = 0; y < n.y; y += rows) {
        const std::int64_t ny = std::min(rows, n.y - y);
        Box<T> theirs({0, y, z}, {n.x, ny, 1});
        gather_values(cache, array, theirs);
        std::vector<T> ours(theirs.data.size());
        source.read(z, 1, y, ny, reinterpret_cast<std::byte*>(ours.data()));
        // Bit by bit: NaN is the same as itself.
        // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison)
        if (std::memcmp(ours.data(), theirs.data.data(), ours.size() * sizeof(T)) != 0) {
            throw Error(ErrorKind::invalid_argument,
                        {source.describe().name, fmt::format("plane {}", z)},
                        "the interrupted run read other values: the input has changed",
                        {{RemedyKind::no_resume}});
        }
    }
}

}  // namespace

void require_same_values(VolumeSource& source, const ChunkSource& store, const Checkpoint& done) {
    if (source.sequential() || done.level == 0) {
        return;
    }
    const StoreLayout& layout = store.layout();
    const std::int64_t nz = layout.lattice().nodes().z;
    const std::int64_t end =
        done.level > 2 ? nz : std::min(nz, 2 * layout.header().chunk * done.rows);
    ChunkCache cache(store, std::uint64_t{8} << 20U);
    dispatch(layout.header().type, [&](auto tag) {
        using T = typename decltype(tag)::type;
        compare_plane<T>(source, cache, 0);
        compare_plane<T>(source, cache, end - 1);
    });
}

}  // namespace isonest::detail
