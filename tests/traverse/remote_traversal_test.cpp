// A remote store gives the same mesh as a local one, with few round trips and little prefetched in
// vain.
#include <algorithm>
#include <catch2/catch.hpp>

#include "query/mesh/part_store.h"
#include "query/mesh/weld.h"
#include "query/traverse/traversal.h"
#include "store/base/workers.h"
#include "store/container/wrapped_sources.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr std::uint64_t kAmple = std::uint64_t{1} << 30U;

struct Outcome {
    std::vector<MeshCollector> meshes;  ///< of each isovalue
    std::vector<TraversalCounts> counts;
    std::uint64_t chunks_read = 0;
    std::uint64_t bytes_read = 0;
    std::uint64_t peak = 0;  ///< of the cache
};

struct Room {
    std::uint64_t cache = kAmple;
    std::uint64_t waiting = kAmple;
    int threads = 2;
};

Outcome outcome_of(const ChunkSource& source, TraversalQuery query,
                   const std::vector<double>& isovalues, const Room& room) {
    const TemporaryFolder folder;
    const StoreHeader& header = source.layout().header();
    std::vector<std::unique_ptr<PartStore>> parts;
    std::vector<PartSink> sinks;
    for (std::size_t i = 0; i < isovalues.size(); ++i) {
        parts.push_back(std::make_unique<PartStore>(folder.path(), header.spacing, header.origin,
                                                    kAmple, query.attributes.width()));
        sinks.emplace_back([to = parts.back().get()](std::uint64_t order, const MeshPart& part) {
            to->append(order, part);
        });
    }
    query.waiting_lists = room.waiting;
    ChunkCache cache(source, room.cache,
                     query.attributes.width() > 0 ? NodeSampler::kSides : ChunkSides{});
    Outcome out;
    Workers(room.threads).execute([&] {
        if (isovalues.size() > 1) {
            out.counts =
                traverse_isovalues(cache, query, isovalues, 4096, sinks, silent_progress());
        } else {
            query.iso = isovalues.front();
            out.counts = {traverse(cache, query, 4096, sinks.front(), silent_progress())};
        }
        out.meshes = std::vector<MeshCollector>(isovalues.size());
        for (std::size_t i = 0; i < isovalues.size(); ++i) {
            parts[i]->seal();
            const Weld weld(*parts[i], folder.path());
            emit_mesh(*parts[i], weld, layout_of(query.attributes, 3, {}, {}), out.meshes[i],
                      silent_progress());
        }
    });
    out.chunks_read = cache.chunks_read();
    out.bytes_read = cache.bytes_read();
    out.peak = cache.peak_bytes();
    return out;
}

void require_same_meshes(const Outcome& a, const Outcome& b) {
    for (std::size_t i = 0; i < a.meshes.size(); ++i) {
        REQUIRE(a.meshes[i].vertices == b.meshes[i].vertices);
        REQUIRE(a.meshes[i].triangles == b.meshes[i].triangles);
        REQUIRE(a.meshes[i].normals == b.meshes[i].normals);
        REQUIRE(a.meshes[i].values == b.meshes[i].values);
        CHECK(a.counts[i].visited == b.counts[i].visited);
        CHECK(a.counts[i].leaves == b.counts[i].leaves);
        CHECK(a.counts[i].bricks == b.counts[i].bricks);
        CHECK(a.counts[i].stopped_at == b.counts[i].stopped_at);
    }
}

struct Case {
    const char* name;
    Extraction asked;
    std::vector<double> isovalues;
    double waste = 1.3;  ///< maximum of the bytes prefetched, relative to those decoded
    int per_level = 1;   ///< maximum of the round trips per level
};

void require_few_round_trips(const StoreReader& store, const Case& c) {
    INFO(c.name);
    Extraction asked = c.asked;
    asked.iso = c.isovalues.front();
    const TraversalQuery query = query_of(store, asked, true).traversal;
    const Outcome local = outcome_of(store, query, c.isovalues, {});
    const RemoteSource source(store);
    const Outcome remote = outcome_of(source, query, c.isovalues, {});
    require_same_meshes(local, remote);
    // A chunk may be prefetched and read before it is known that it is not needed.
    CHECK(remote.chunks_read <= local.chunks_read + local.chunks_read / 16);
    CHECK(remote.bytes_read <= local.bytes_read + local.bytes_read / 16);
    const RemoteCounts counts = source.counts();
    INFO("prefetched " << counts.fetched_bytes << " of " << counts.decoded_bytes << ", "
                       << counts.not_prefetched << " not_prefetched");
    const int levels = store.layout().lattice().top() + 1;
    // With exact vertices, only the one or two chunks on an edge are prefetched at once.
    CHECK(counts.round_trips <= (query.vertices == VertexPlace::exact
                                     ? counts.decoded_chunks / 3
                                     : static_cast<std::uint64_t>(c.per_level * levels + 3)));
    CHECK(static_cast<double>(counts.fetched_bytes) <=
          c.waste * static_cast<double>(counts.decoded_bytes));
    if (std::getenv("ISONEST_REMOTE_FIGURES") != nullptr) {
        std::printf(
            "%-28s levels %2d rt %3d ann %3d unann %3d chunks %5d/%5d bytes %8d/%8d %.2f\n", c.name,
            levels, static_cast<int>(counts.round_trips), static_cast<int>(counts.prefetches),
            static_cast<int>(counts.not_prefetched), static_cast<int>(counts.fetched_chunks),
            static_cast<int>(counts.decoded_chunks), static_cast<int>(counts.fetched_bytes),
            static_cast<int>(counts.decoded_bytes),
            static_cast<double>(counts.fetched_bytes) / static_cast<double>(counts.decoded_bytes));
    }
}

void require_same_with_little(const StoreReader& store, const Case& c) {
    INFO(c.name);
    Extraction asked = c.asked;
    asked.iso = c.isovalues.front();
    const TraversalQuery query = query_of(store, asked, true).traversal;
    const Outcome local = outcome_of(store, query, c.isovalues, {});
    const std::uint64_t each = c.isovalues.size() * TraversalHeap(store.layout(), query).chunks();
    const std::uint64_t chunk = largest_chunk_bytes(store.layout()) + 256;
    for (const int threads : {1, 3}) {
        for (const std::uint64_t waiting : {std::uint64_t{0}, std::uint64_t{100000}}) {
            const RemoteSource source(store);
            const Room room{static_cast<std::uint64_t>(threads) * each + 4 * chunk, waiting,
                            threads};
            const Outcome remote = outcome_of(source, query, c.isovalues, room);
            require_same_meshes(local, remote);
            // A chunk that is decoded for its sides is needed in addition.
            CHECK(remote.peak <= room.cache + static_cast<std::uint64_t>(threads) * chunk);
        }
    }
}

std::vector<Case> cases(double iso, double range, const Int3& n) {
    Extraction coarse;
    coarse.error = 0.05 * range;
    Extraction fine;
    fine.error = 0.01 * range;
    Extraction slice = fine;
    slice.plane = WorldPlane{{1, 0.3, 0.2}, 0.6 * static_cast<double>(n.x)};
    Extraction whole_slice = slice;
    whole_slice.error = 0;
    Extraction node_slice = fine;
    node_slice.plane = WorldPlane{{0, 0, 1}, 16};
    Extraction box = fine;
    box.box = WorldBox{{3, 5, 7}, {n.x * 0.6, n.y * 0.5, n.z * 0.7}};
    Extraction closed = box;
    closed.close = Outside::below;
    Extraction culled = fine;
    culled.view = Double3{1, 0.2, 0.1};
    Extraction full;
    full.error = 0;
    Extraction full_box = box;
    full_box.error = 0;
    Extraction full_culled = culled;
    full_culled.error = 0;
    Extraction hexahedra = full;
    hexahedra.cells = Cells::hexahedra;
    Extraction adaptive_hexahedra = fine;
    adaptive_hexahedra.cells = Cells::hexahedra;
    adaptive_hexahedra.normals = true;
    Extraction hexahedra_slice = slice;
    hexahedra_slice.cells = Cells::hexahedra;
    Extraction exact = fine;
    exact.vertices = VertexPlace::exact;
    Extraction coarse_exact = coarse;
    coarse_exact.vertices = VertexPlace::exact;
    Extraction slice_normals = node_slice;
    slice_normals.normals = true;
    Extraction normals = fine;
    normals.normals = true;
    Extraction full_normals = full;
    full_normals.normals = true;
    const double b = iso + 0.05 * range;
    return {
        {"coarse", coarse, {iso}},
        {"fine", fine, {iso}},
        {"slice", slice, {iso}},
        {"full slice", whole_slice, {iso}},
        {"slice through nodes", node_slice, {iso}},
        {"box", box, {iso}},
        {"closed box", closed, {iso}},
        {"culled", culled, {iso}},
        {"full", full, {iso}},
        {"full box", full_box, {iso}},
        {"full culled", full_culled, {iso}},
        {"hexahedra", hexahedra, {iso}},
        {"two isovalues", fine, {iso, b}},
        {"two isovalues, full", full, {iso, b}},
        {"hexahedra, fine", adaptive_hexahedra, {iso}, 1.5, 2},
        {"slice by hexahedra", hexahedra_slice, {iso}, 1.8, 2},
        {"exact vertices", exact, {iso}, 1.5, 3},
        {"coarse, exact vertices", coarse_exact, {iso}, 1.5, 3},
        {"exact vertices, two isovalues", exact, {iso, b}, 1.5, 3},
        {"slice with normals", slice_normals, {iso}, 1.3, 2},
        {"normals", normals, {iso}},
        {"normals, full", full_normals, {iso}},
    };
}

PreprocessOptions with_gradients(int chunk) {
    PreprocessOptions options = with_chunk(chunk);
    options.fields = {Field::deviation_bar, Field::grad_linf_plus, Field::hex_deviation};
    return options;
}

}  // namespace

TEST_CASE("a remote store is read in one round trip per level, and gives the same mesh") {
    const TemporaryFolder folder;
    const Int3 n{97, 129, 110};
    FunctionVolume<std::uint8_t> bytes(n, [](const Int3& p) {
        return static_cast<std::uint8_t>(std::clamp(110 + 40 * smooth(p), 0.0, 255.0));
    });
    FunctionVolume<float> reals(n, [](const Int3& p) {
        const Int3 d = p - Int3{40, 60, 50};
        return static_cast<float>(std::sqrt(d.x * d.x + d.y * d.y + d.z * d.z) + 2 * smooth(p));
    });
    make_store(bytes, folder / "bytes", with_gradients(16));
    make_store(reals, folder / "reals", with_gradients(8));
    const StoreReader byte_store(folder / "bytes");
    const StoreReader real_store(folder / "reals");
    for (const Case& c : cases(110, 200, n)) {
        require_few_round_trips(byte_store, c);
    }
    for (const Case& c : cases(33, 100, n)) {
        require_few_round_trips(real_store, c);
    }
}

TEST_CASE("with little memory a remote store gives the same mesh within it") {
    const TemporaryFolder folder;
    const Int3 n{70, 65, 90};
    FunctionVolume<std::int16_t> volume(n, [](const Int3& p) {
        return static_cast<std::int16_t>(1000 * smooth(p) + 100 * noise(p));
    });
    make_store(volume, folder / "s", with_gradients(16));
    const StoreReader store(folder / "s");
    for (const Case& c : cases(100, 3000, n)) {
        require_same_with_little(store, c);
    }
}

TEST_CASE("a coarse surface of a remote store requests no row of the finest level") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({129, 129, 129}, [](const Int3& p) {
        const Int3 d = p - Int3{64, 64, 64};
        return static_cast<float>(std::sqrt(d.x * d.x + d.y * d.y + d.z * d.z));
    });
    make_store(volume, folder / "s", with_chunk(16));
    const StoreReader store(folder / "s");
    const RemoteSource source(store);
    Extraction asked;
    asked.error = 3;
    const Outcome remote = outcome_of(source, query_of(store, asked, true).traversal, {40}, {});
    CHECK(!remote.meshes.front().triangles.empty());
    CHECK(!source.rows_of_level().contains(0));
}
