// Prefetching in a known order, with a simulated network.
#include <atomic>
#include <catch2/catch.hpp>

#include "store/base/workers.h"
#include "store/container/chunk_cache.h"
#include "store/container/reader.h"
#include "store/container/wrapped_sources.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// A chunk takes 2 MiB decoded, so that windows of 8 MiB hold four.
constexpr std::int64_t kChunksOfWindow = 4;

struct Reading {
    std::map<std::int64_t, int> items;
    RemoteCounts counts;
};

Reading read_all(const ChunkSource& store, bool with_cache, int threads) {
    const RemoteSource far(store);
    const ArrayInfo& array = store.layout().array(0, Field::values);
    ChunkCache cache(far, std::uint64_t{1} << 30U);
    const auto wanted = [&](std::int64_t i, std::vector<WantedChunk>& chunks) {
        chunks.push_back({&array, array.grid.unlinear(i)});
        // Beyond the grid: ignored.
        chunks.push_back({&array, array.grid});
    };
    const std::int64_t count = array.grid.product();
    Prefetcher prefetcher =
        with_cache ? Prefetcher(cache, 0, count, wanted) : Prefetcher(far, 0, count, wanted);
    Reading out;
    std::mutex mutex;
    Workers(threads).execute([&] {
        for_each_prefetched(far, prefetcher, 0, count, [&](std::int64_t i) {
            std::vector<std::byte> raw(array.chunk_bytes());
            if (with_cache) {
                cache.get(array, array.grid.unlinear(i));
            } else {
                far.decode(array, array.grid.unlinear(i), raw);
            }
            const std::lock_guard lock(mutex);
            ++out.items[i];
        });
    });
    out.counts = far.counts();
    return out;
}

}  // namespace

TEST_CASE("chunks read in a known order are prefetched, with at most one wait per window") {
    const TemporaryFolder folder;
    FunctionVolume<double> volume({190, 130, 129}, [](const Int3& p) { return smooth(p); });
    make_store(volume, folder / "s", with_chunk(64));
    const StoreReader store(folder / "s");
    const ArrayInfo& array = store.layout().array(0, Field::values);
    REQUIRE(array.chunk_bytes() == 2U << 20U);
    const std::int64_t count = array.grid.product();
    REQUIRE(count > 3 * kChunksOfWindow);
    for (const bool with_cache : {false, true}) {
        for (const int threads : {1, 3}) {
            const Reading reading = read_all(store, with_cache, threads);
            CHECK(reading.items.size() == static_cast<std::size_t>(count));
            CHECK(std::all_of(reading.items.begin(), reading.items.end(),
                              [](const auto& item) { return item.second == 1; }));
            CHECK(reading.counts.not_prefetched == 0);
            CHECK(reading.counts.fetched_chunks == static_cast<std::uint64_t>(count));
            CHECK(reading.counts.fetched_bytes == reading.counts.decoded_bytes);
            // Windows end one chunk later, because chunks beyond the grid count as well.
            CHECK(reading.counts.round_trips <= static_cast<std::uint64_t>(count / 2 + 1));
        }
    }
}

TEST_CASE("a local source gets no prefetch requests") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({40, 40, 40},
                                 [](const Int3& p) { return static_cast<float>(smooth(p)); });
    make_store(volume, folder / "s", with_chunk(16));
    const StoreReader store(folder / "s");
    const ArrayInfo& array = store.layout().array(0, Field::values);
    std::atomic<int> asked = 0;
    Prefetcher prefetcher(store, 0, array.grid.product(),
                          [&](std::int64_t, std::vector<WantedChunk>&) { ++asked; });
    std::atomic<int> done = 0;
    for_each_prefetched(store, prefetcher, 0, array.grid.product(), [&](std::int64_t) { ++done; });
    CHECK(done == array.grid.product());
    CHECK(asked == 0);
}

TEST_CASE("what is in the cache is not prefetched") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({40, 40, 40},
                                 [](const Int3& p) { return static_cast<float>(smooth(p)); });
    make_store(volume, folder / "s", with_chunk(16));
    const StoreReader store(folder / "s");
    const RemoteSource far(store);
    const ArrayInfo& array = store.layout().array(0, Field::values);
    ChunkCache cache(far, 1U << 20U);
    cache.get(array, {0, 0, 0});
    CHECK(far.counts().not_prefetched == 1);
    const std::vector<NeededChunk> needed{{&array, {0, 0, 0}}, {&array, {1, 0, 0}}};
    cache.prefetch(needed);
    CHECK(far.counts().fetched_chunks == 2);  // one of which had been read without a prefetch
    cache.get(array, {1, 0, 0});
    CHECK(far.counts().round_trips == 2);
    CHECK(far.counts().not_prefetched == 1);
    // If only the sides of a chunk are needed and present, it is not prefetched.
    cache.keep_sides(array, {1, 0, 0});
    const std::vector<NeededChunk> sides{{&array, {1, 0, 0}, false}};
    cache.prefetch(sides);
    CHECK(far.counts().fetched_chunks == 2);
    cache.prefetch(needed);
    CHECK(far.counts().fetched_chunks == 3);
}
