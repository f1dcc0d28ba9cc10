// Concurrent extractions from one store: each gives the same mesh and report as alone.
#include <algorithm>
#include <catch2/catch.hpp>
#include <thread>

#include <isonest/extract.h>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail::test;

namespace {

struct Extracted {
    ExtractReport report;
    std::vector<std::array<float, 3>> positions;
    std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// With little memory the cache drops chunks, and some are read again.
Extracted extracted(const Store& store, const SurfaceQuery& query) {
    MeshCollector mesh;
    ExtractOptions options;
    options.threads = 1;
    options.memory = std::uint64_t{24} << 20U;
    const ExtractReport report = extract(store, query, mesh, options);
    return {report, std::move(mesh.vertices), std::move(mesh.triangles)};
}

void require_same(const Extracted& a, const Extracted& b) {
    CHECK(a.positions == b.positions);
    CHECK(a.triangles == b.triangles);
    CHECK(a.report.traversal.chunks_read == b.report.traversal.chunks_read);
    CHECK(a.report.traversal.bytes_read == b.report.traversal.bytes_read);
    CHECK(a.report.traversal.peak_cache_bytes == b.report.traversal.peak_cache_bytes);
    CHECK(a.report.traversal.visited == b.report.traversal.visited);
    CHECK(a.report.traversal.leaves == b.report.traversal.leaves);
    CHECK(a.report.traversal.bricks == b.report.traversal.bricks);
    CHECK(a.report.error_bound == b.report.error_bound);
    CHECK(a.report.vertices == b.positions.size());
    CHECK(a.report.triangles == b.triangles.size());
}

}  // namespace

TEST_CASE("two concurrent extractions from one store report the same as each alone") {
    FunctionVolume<float> volume({129, 97, 65},
                                 [](const Int3& p) { return static_cast<float>(smooth(p)); });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(16));
    const Store store(folder / "s");
    SurfaceQuery fine;
    fine.iso = 0.2;
    SurfaceQuery coarse;
    coarse.iso = 2.5;
    coarse.stop = ErrorBound{0.3, false, ErrorIndicator::deviation};
    coarse.effort = Effort::none;
    coarse.attributes.normals = true;
    const Extracted fine_alone = extracted(store, fine);
    const Extracted coarse_alone = extracted(store, coarse);
    REQUIRE(!fine_alone.triangles.empty());
    REQUIRE(!coarse_alone.triangles.empty());
    REQUIRE(fine_alone.report.traversal.chunks_read != coarse_alone.report.traversal.chunks_read);
    for (int round = 0; round < 3; ++round) {
        Extracted fine_beside;
        Extracted coarse_beside;
        std::thread other([&] { coarse_beside = extracted(store, coarse); });
        fine_beside = extracted(store, fine);
        other.join();
        require_same(fine_beside, fine_alone);
        require_same(coarse_beside, coarse_alone);
    }
}
