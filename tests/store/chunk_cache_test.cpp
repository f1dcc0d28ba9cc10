// What the cache keeps of a chunk, and how often a traversal decodes a chunk.
#include "store/container/chunk_cache.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <cstring>
#include <thread>

#include "query/traverse/traversal.h"
#include "query/values/node_sampler.h"
#include "store/base/workers.h"
#include "store/container/wrapped_sources.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

const std::byte* element(const ChunkNodes& nodes, const Int3& p, std::size_t bytes) {
    const std::int64_t at = p.x * nodes.stride.x + p.y * nodes.stride.y + p.z * nodes.stride.z;
    return nodes.data.get() + static_cast<std::size_t>(at) * bytes;
}

/// Compares the three low sides with those of the chunk as its source decodes it.
void require_low_sides(ChunkCache& cache, const ArrayInfo& array, const Int3& chunk) {
    std::vector<std::byte> whole(array.chunk_bytes());
    cache.source().decode(array, chunk, whole);
    const std::size_t bytes = array.codec.element_size * static_cast<std::size_t>(array.components);
    for (int axis = 0; axis < 3; ++axis) {
        Int3 size = array.chunk;
        size[axis] = 1;
        const ChunkNodes side = cache.nodes(array, chunk, 1U << static_cast<unsigned>(axis));
        for (std::int64_t i = 0; i < size.product(); ++i) {
            const Int3 p = size.unlinear(i);
            const auto at = static_cast<std::size_t>(array.chunk.linear(p)) * bytes;
            REQUIRE(std::memcmp(element(side, p, bytes), whole.data() + at, bytes) == 0);
        }
    }
}

}  // namespace

TEST_CASE("the low sides of a chunk are its nodes, for any array and size") {
    for (const Int3& n : {Int3{40, 21, 33}, Int3{5, 33, 17}, Int3{1, 40, 20}, Int3{9, 1, 1}}) {
        const TemporaryFolder folder;
        FunctionVolume<std::int16_t> volume(
            n, [](const Int3& p) { return static_cast<std::int16_t>(30000 * noise(p)); });
        make_store(volume, folder / "s", with_chunk(16));
        const StoreReader store(folder / "s");
        const RecordingSource counted(store);
        for (const ArrayInfo& array : store.layout().arrays()) {
            ChunkCache cache(counted, 1U << 24U);
            for (std::int64_t i = 0; i < array.grid.product(); ++i) {
                const Int3 chunk = array.grid.unlinear(i);
                require_low_sides(cache, array, chunk);  // of the whole chunk
                cache.keep_sides(array, chunk);
                const auto before = counted.decoded().at(array.row_of(chunk));
                require_low_sides(cache, array, chunk);
                // The one decoding is that of the comparison itself: the sides alone were still
                // there.
                CHECK(counted.decoded().at(array.row_of(chunk)) == before + 1);
                // The whole chunk is available again on demand.
                std::vector<std::byte> whole(array.chunk_bytes());
                store.decode(array, chunk, whole);
                const DecodedChunk again = cache.get(array, chunk);
                CHECK(std::memcmp(again.get(), whole.data(), whole.size()) == 0);
                require_low_sides(cache, array, chunk);
            }
        }
    }
}

TEST_CASE("a chunk that is in use, or not in the cache, is not reduced to its low sides") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({20, 20, 20},
                                 [](const Int3& p) { return static_cast<float>(smooth(p)); });
    make_store(volume, folder / "s", with_chunk(16));
    const StoreReader store(folder / "s");
    const RecordingSource counted(store);
    const ArrayInfo& array = store.layout().array(0, Field::values);
    ChunkCache cache(counted, 1U << 24U);
    cache.keep_sides(array, {1, 1, 1});
    CHECK(cache.peak_bytes() == 0);
    const DecodedChunk held = cache.get(array, {0, 0, 0});
    cache.keep_sides(array, {0, 0, 0});
    CHECK(cache.get(array, {0, 0, 0}).get() == held.get());
    CHECK(counted.decoded().at(array.row_of({0, 0, 0})) == 1);
}

TEST_CASE("low sides requested while their chunk is reduced to them are not decoded again") {
    const TemporaryFolder folder;
    FunctionVolume<std::uint8_t> volume(
        {64, 64, 64}, [](const Int3& p) { return static_cast<std::uint8_t>(255 * noise(p)); });
    make_store(volume, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    const RecordingSource counted(store);
    const ArrayInfo& array = store.layout().array(0, Field::values);
    ChunkCache cache(counted, 1U << 24U);
    const std::int64_t chunks = array.grid.product();
    std::atomic<std::int64_t> at = 0;
    std::vector<std::thread> readers;
    readers.reserve(3);
    for (unsigned i = 0; i < 3; ++i) {
        readers.emplace_back([&, axis = i] {
            while (at < chunks) {
                cache.nodes(array, array.grid.unlinear(std::min(at.load(), chunks - 1)),
                            1U << axis);
            }
        });
    }
    for (std::int64_t i = 0; i < chunks; ++i) {
        at = i;
        const Int3 chunk = array.grid.unlinear(i);
        cache.get(array, chunk);
        cache.keep_sides(array, chunk);
    }
    at = chunks;
    for (std::thread& reader : readers) {
        reader.join();
    }
    std::int64_t decoded = 0;
    for (const auto& [row, times] : counted.decoded()) {
        decoded += times;
    }
    CHECK(decoded == chunks);
}

TEST_CASE(
    "a full surface decodes each chunk once, with memory for a few chunks and the sides of all") {
    const TemporaryFolder folder;
    FunctionVolume<std::uint8_t> volume(
        {97, 90, 99}, [](const Int3& p) { return static_cast<std::uint8_t>(255 * noise(p)); });
    make_store(volume, folder / "s", with_chunk(16));
    const StoreReader store(folder / "s");
    const RecordingSource counted(store);
    const ArrayInfo& array = store.layout().array(0, Field::values);
    const auto chunks = static_cast<std::uint64_t>(array.grid.product());
    constexpr std::uint64_t kSides = 3 * 16 * 16;
    constexpr std::uint64_t kOverhead = 256;
    const std::uint64_t budget =
        8 * (array.chunk_bytes() + kOverhead) + chunks * (kSides + kOverhead);
    REQUIRE(3 * budget < chunks * array.chunk_bytes());
    ChunkCache cache(counted, budget);
    TraversalQuery query;
    query.iso = 100;
    query.box.hi = {96, 89, 98};
    std::uint64_t triangles = 0;
    Workers(1).execute([&] {
        traverse(
            cache, query, 4096,
            [&](std::uint64_t, const MeshPart& part) { triangles += part.triangles.size(); },
            silent_progress());
    });
    CHECK(triangles > 1000000);
    CHECK(counted.decoded().size() == chunks);
    for (const auto& [row, times] : counted.decoded()) {
        CHECK(times == 1);
    }
    // One more chunk may be decoded for its sides.
    CHECK(cache.peak_bytes() <= budget + array.chunk_bytes() + kOverhead);
}

TEST_CASE("a full surface with normals and vertex values decodes each chunk at most twice") {
    const TemporaryFolder folder;
    FunctionVolume<std::uint8_t> volume(
        {131, 120, 140}, [](const Int3& p) { return static_cast<std::uint8_t>(255 * noise(p)); });
    make_store(volume, folder / "s", with_chunk(32));
    const StoreReader store(folder / "s");
    const RecordingSource counted(store);
    const RecordingSource counted_values(store);
    const ArrayInfo& array = store.layout().array(0, Field::values);
    const auto chunks = static_cast<std::uint64_t>(array.grid.product());
    // A few chunks, and the sides of all.
    constexpr std::uint64_t kSides = 3 * 4 * 32 * 32;
    const std::uint64_t budget = 16 * array.chunk_bytes() + chunks * (kSides + 256);
    REQUIRE(2 * budget < chunks * array.chunk_bytes() * 3);
    ChunkCache cache(counted, budget, NodeSampler::kSides);
    ChunkCache values(counted_values, budget);
    TraversalQuery query;
    query.iso = 100;
    query.box.hi = {130, 119, 139};
    query.attributes.normal = true;
    query.attributes.value = true;
    query.attributes.error = Field::deviation_bar;
    query.attribute_values = &values;
    Workers(1).execute([&] {
        traverse(
            cache, query, 4096, [](std::uint64_t, const MeshPart&) {}, silent_progress());
    });
    for (const RecordingSource* source : {&counted, &counted_values}) {
        std::uint64_t decoded = 0;
        for (const auto& [row, times] : source->decoded()) {
            CHECK(times <= 2);
            decoded += static_cast<std::uint64_t>(times);
        }
        CHECK(decoded >= chunks);
    }
}
