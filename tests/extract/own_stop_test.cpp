// Meshes and slices stopped by an indicator of the caller.
#include <catch2/catch.hpp>
#include <cmath>

#include <isonest/own_indicator.h>

#include "store/container/reader.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

TEST_CASE("a mesh stopped by an own indicator equals that of the built-in one with its formula") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({49, 37, 42},
                                 [](const Int3& p) { return static_cast<float>(noise(p)); });
    PreprocessOptions options = with_chunk(8);
    // Of linf, level 1 stores only the centres; the other nodes are computed, not rounded up.
    options.exact = true;
    options.own = {
        own_indicator("offset", [](const RefinementNode& x) { return std::fabs(x.offset()); })};
    make_store(volume, folder / "s", options);
    const StoreReader store(folder / "s");
    for (const Saturation saturation : {Saturation::bar, Saturation::plus}) {
        for (const bool slice : {false, true}) {
            Extraction e;
            e.iso = 0.5;
            e.threshold = 0.4;
            if (slice) {
                e.plane = WorldPlane{{1, 2, 3}, 120};
            }
            e.stop = field_of(Indicator::linf, saturation);
            extract(store, folder / "linf.ply", e, silent_progress());
            e.stop = own_field("offset", saturation);
            extract(store, folder / "own.ply", e, silent_progress());
            const std::string expected = read_file(folder / "linf.ply");
            REQUIRE(expected.size() > 1000);
            const bool same = read_file(folder / "own.ply") == expected;
            CHECK(same);
        }
    }
}
