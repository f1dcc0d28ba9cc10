// Extractions whose meshes are simplified by several ranks: the same bytes as one process.
#include <catch2/catch.hpp>
#include <functional>

#include <isonest/extract.h>
#include <isonest/labels.h>
#include <isonest/mesh_file.h>

#include "query/extract/extract_shared.h"
#include "tests/support/test_support.h"
#include "tests/support/thread_ranks.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr std::uint64_t kEnough = std::uint64_t{1} << 30U;

/// Extracts into the sink.
using ExtractInto = std::function<ExtractReport(const ExtractOptions&, MeshSink&)>;

struct Simplified {
    std::string bytes;
    ExtractReport report;
    std::vector<RankWork> work;
};

Simplified simplified_on(int count, const Store& store, const ExtractInto& extract_into,
                         std::uint64_t memory = kEnough) {
    const TemporaryFolder folder;
    const auto path = folder.path() / "mesh.ply";
    Simplified s;
    s.work.resize(static_cast<std::size_t>(count));
    isonest::test::ThreadRanks(count).run([&](Communicator& ranks) {
        s.work[static_cast<std::size_t>(ranks.rank())] = extract_on_ranks(
            ranks, store, nullptr,
            [&](const ExtractOptions& options) {
                const auto sink = open_mesh_file(path);
                s.report = extract_into(options, *sink);
            },
            {memory, 2, {}}, silent_progress());
    });
    s.bytes = read_file(path);
    return s;
}

/// REQUIRES: more than a few blocks. `memory`: of each rank.
void require_same_simplified(const Store& store, const ExtractInto& extract_into,
                             std::uint64_t memory = kEnough) {
    const TemporaryFolder folder;
    const auto path = folder.path() / "mesh.ply";
    ExtractReport report;
    {
        const auto sink = open_mesh_file(path);
        report = extract_into({kEnough, 2, {}}, *sink);
    }
    const std::string bytes = read_file(path);
    std::uint64_t triangles = 0;
    for (const int count : {2, 3, 5}) {
        const Simplified s = simplified_on(count, store, extract_into, memory);
        REQUIRE(s.bytes == bytes);
        REQUIRE(s.report.triangles == report.triangles);
        REQUIRE(s.report.distance);
        REQUIRE(s.report.distance->bound == report.distance->bound);
        REQUIRE(s.report.distance->asked == report.distance->asked);
        REQUIRE(s.report.within_budget == report.within_budget);
        std::uint64_t mapped = 0;
        for (const RankWork& work : s.work) {
            REQUIRE(work.mappings == 1);
            REQUIRE(work.mapped_blocks > 0);
            REQUIRE(work.mapped_triangles > 0);
            mapped += work.mapped_triangles;
        }
        // The sum over all passes is the same for any assignment of blocks to ranks.
        REQUIRE(mapped > report.distance->full_triangles);
        REQUIRE((triangles == 0 || mapped == triangles));
        triangles = mapped;
    }
    REQUIRE(simplified_on(1, store, extract_into).bytes == bytes);
}

}  // namespace

TEST_CASE("ranks simplify a surface within a distance, or to a number of triangles") {
    const TemporaryFolder folder;
    FunctionVolume<float> source({129, 97, 65}, [](const Int3& p) {
        return static_cast<float>(smooth(p) + 0.1 * noise(p));
    });
    make_store(source, folder / "s", with_chunk(16));
    const Store store(folder / "s");
    SurfaceQuery query;
    query.iso = 0.2;
    const ExtractInto surface = [&](const ExtractOptions& options, MeshSink& sink) {
        return extract(store, query, sink, options);
    };
    SECTION("within a distance") {
        query.stop = DistanceBound{0.5};
        query.effort = Effort::fast;
        require_same_simplified(store, surface);
        require_same_simplified(store, surface, std::uint64_t{48} << 20U);
    }
    SECTION("within a distance, in a closed box, with normals") {
        query.stop = DistanceBound{0.8};
        query.effort = Effort::fast;
        query.box = WorldBox{{3.3, 4.1, 2.7}, {121.2, 89.9, 62.5}};
        query.stages.close = Outside::below;
        query.attributes.normals = true;
        require_same_simplified(store, surface);
    }
    SECTION("to a number of triangles") {
        query.stop = TriangleBudgetByDistance{20000};
        query.effort = Effort::fast;
        require_same_simplified(store, surface);
    }
}

TEST_CASE("ranks simplify smooth labels together") {
    const TemporaryFolder folder;
    FunctionVolume<std::uint8_t> source({56, 50, 45}, [](const Int3& p) {
        return static_cast<std::uint8_t>(std::lround(4 + 2 * smooth(p) + 0.7 * noise(p)));
    });
    make_store(source, folder / "s", with_chunk(16));
    const Store store(folder / "s");
    LabelQuery query;
    query.smooth = LabelSmoothing{};
    query.stages.close = Outside::below;
    for (const bool keeps : {false, true}) {
        query.smooth->keep_nodes = keeps;
        query.stop = DistanceBound{0.6};
        query.effort = Effort::fast;
        require_same_simplified(store, [&](const ExtractOptions& options, MeshSink& sink) {
            return extract_interfaces(
                store, find_labels(store), query, sink, [](const LabelInterface&) {}, options,
                silent_progress());
        });
    }
}
