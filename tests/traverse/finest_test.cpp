// Without a tolerance: exactly the finest tetrahedra that the surface crosses.
#include <catch2/catch.hpp>
#include <mutex>
#include <set>

#include "query/traverse/traversal.h"
#include "store/container/wrapped_sources.h"
#include "store/lattice/simplex.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

using Key = std::array<std::array<std::int64_t, 3>, 4>;

Key key_of(const std::array<Int3, 4>& nodes) {
    Key key{};
    for (std::size_t i = 0; i < 4; ++i) {
        key[i] = {nodes[i].x, nodes[i].y, nodes[i].z};
    }
    std::sort(key.begin(), key.end());
    return key;
}

template <class T>
void require_finest(FunctionVolume<T>& volume, double iso, int chunk, std::uint64_t cache_bytes) {
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(chunk));
    const StoreReader store(folder / "s");
    const RecordingSource watched(store);
    const ArrayInfo& array = store.layout().array(0, Field::values);
    ChunkCache cache(watched, cache_bytes);
    TraversalQuery query;
    query.iso = iso;
    const Int3 last = volume.nodes() - Int3{1, 1, 1};
    query.box.hi = {static_cast<double>(last.x), static_cast<double>(last.y),
                    static_cast<double>(last.z)};
    std::mutex mutex;
    std::multiset<Key> leaves;
    query.on_leaf = [&](const Leaf& leaf) {
        std::array<Int3, 4> nodes;
        for (std::size_t i = 0; i < 4; ++i) {
            nodes[i] = leaf.corners[i].node;
        }
        const std::lock_guard lock(mutex);
        leaves.insert(key_of(nodes));
    };
    const TraversalCounts counts = traverse(
        cache, query, 4096, [](std::uint64_t, const MeshPart&) {}, silent_progress());

    std::multiset<Key> expected;
    std::set<std::uint64_t> touched;
    for (std::int64_t i = 0; i < last.product(); ++i) {
        for (int order = 0; order < 6; ++order) {
            const Tetrahedron t = kuhn_tetrahedron(last.unlinear(i), 1, order);
            int below = 0;
            bool missing = false;
            for (const Int3& v : t.v) {
                below += volume.at(v) < iso ? 1 : 0;
                missing = missing || !std::isfinite(volume.at(v));
            }
            if (missing || below == 0 || below == 4) {
                continue;
            }
            expected.insert(key_of(t.v));
            for (const Int3& v : t.v) {
                touched.insert(array.row_of(array.chunk_of(v)));
            }
        }
    }
    CHECK(leaves == expected);
    CHECK(counts.leaves == expected.size());
    const std::uint64_t first = array.row_of({0, 0, 0});
    for (const auto& [row, times] : watched.decoded()) {
        CHECK((row >= first && row < first + static_cast<std::uint64_t>(array.grid.product())));
    }
    for (const std::uint64_t row : touched) {
        CHECK(watched.decoded().contains(row));
    }
    // Only chunks with values on both sides in or beside them are read.
    for (std::int64_t i = 0; i < array.grid.product(); ++i) {
        const Int3 at = array.grid.unlinear(i);
        double low = std::numeric_limits<double>::infinity();
        double high = -low;
        for (std::int64_t n = 0; n < 27; ++n) {
            const Int3 beside = at + Int3{3, 3, 3}.unlinear(n) - Int3{1, 1, 1};
            if (min(beside, {0, 0, 0}) == Int3{0, 0, 0} &&
                max(beside + Int3{1, 1, 1}, array.grid) == array.grid) {
                low = std::min(low, store.row(array, beside).min);
                high = std::max(high, store.row(array, beside).max);
            }
        }
        CHECK(((low < iso && high >= iso) || !watched.decoded().contains(array.row_of(at))));
    }
}

}  // namespace

TEST_CASE("without a tolerance the leaves are the finest tetrahedra that the surface crosses") {
    for (const Int3 n : {Int3{2, 2, 2}, Int3{3, 2, 9}, Int3{17, 17, 17}, Int3{16, 9, 23},
                         Int3{8, 25, 33}, Int3{31, 18, 7}}) {
        FunctionVolume<std::uint8_t> bytes(
            n, [](const Int3& p) { return static_cast<std::uint8_t>(90 + 40 * smooth(p)); });
        FunctionVolume<std::int16_t> rough(
            n, [](const Int3& p) { return static_cast<std::int16_t>(-300 + 600 * noise(p)); });
        FunctionVolume<double> wide(n, [](const Int3& p) { return 1e300 * smooth(p); });
        for (const int chunk : {8, 16}) {
            require_finest(bytes, 90, chunk, 1U << 20U);
            require_finest(bytes, 101.5, chunk, 1U << 20U);
            require_finest(rough, 0, chunk, 1U << 12U);
            require_finest(wide, 1e299, chunk, 1U << 20U);
        }
    }
}

TEST_CASE("without a tolerance missing values and both extremes of a type are handled") {
    constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    FunctionVolume<float> holes({19, 22, 17}, [](const Int3& p) {
        const double where = noise(p, 3);
        return where < 0.05   ? kNan
               : where < 0.08 ? kInfinity
               : where < 0.1  ? -kInfinity
                              : static_cast<float>(smooth(p));
    });
    for (const double iso : {0.0, 0.3, -0.7}) {
        require_finest(holes, iso, 8, 1U << 20U);
    }
    FunctionVolume<std::uint32_t> ends({12, 17, 9}, [](const Int3& p) {
        return noise(p) < 0.5 ? 0U : std::numeric_limits<std::uint32_t>::max();
    });
    for (const double iso : {0.0, 0.5, 4294967294.5, 4294967295.0, 4294967296.0}) {
        require_finest(ends, iso, 8, 1U << 20U);
    }
    // 0.1 is between two floats: the one above it is the first that is not below.
    FunctionVolume<float> between({9, 9, 9}, [](const Int3& p) {
        return (p.x + p.y + p.z) % 2 == 0 ? 0.1F : std::nextafter(0.1F, 0.0F);
    });
    for (const double iso : {0.1, static_cast<double>(0.1F)}) {
        require_finest(between, iso, 8, 1U << 20U);
    }
}
