// A number of triangles of the nested grid: the result is the extraction with the error that the
// search found.
#include <catch2/catch.hpp>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/mesh_file.h>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

ExtractReport extract_to(const Store& store, double iso, const SurfaceStop& stop,
                         const std::filesystem::path& path) {
    const auto sink = open_mesh_file(path, {.replace = true});
    return extract(store, SurfaceQuery{.iso = iso, .stop = stop}, *sink);
}

}  // namespace

TEST_CASE("A number of triangles gives the mesh of the reported error and is not exceeded") {
    const TemporaryFolder folder;
    FunctionVolume<float> volume({33, 29, 41}, [](const Int3& p) {
        const auto x = static_cast<double>(p.x);
        const auto y = static_cast<double>(p.y);
        const auto z = static_cast<double>(p.z);
        return static_cast<float>(z + 2 * std::sin(x / 5) + 0.2 * std::sin(x + 2 * y));
    });
    make_store(volume, folder / "s", with_chunk(8));
    const Store store(folder / "s");
    const std::uint64_t full =
        extract_to(store, 20.3, ErrorBound{0}, folder / "full.ply").triangles;
    const std::uint64_t coarsest =
        extract_to(store, 20.3, ErrorBound{1000}, folder / "coarsest.ply").triangles;
    REQUIRE(coarsest > 1);
    REQUIRE(coarsest < full / 4);
    double last = 1e300;
    for (const double share : {0.25, 0.5, 0.9}) {
        const auto most = static_cast<std::uint64_t>(share * static_cast<double>(full));
        const ExtractReport r =
            extract_to(store, 20.3, TriangleBudgetByError{most}, folder / "n.ply");
        REQUIRE(r.within_budget == true);
        REQUIRE(r.triangles <= most);
        REQUIRE(r.triangles > most / 4);
        REQUIRE(r.error_bound <= r.tolerance);
        REQUIRE(r.tolerance <= last);
        last = r.tolerance;
        extract_to(store, 20.3, ErrorBound{r.tolerance}, folder / "same.ply");
        REQUIRE(read_file(folder / "n.ply") == read_file(folder / "same.ply"));
    }
    const ExtractReport all =
        extract_to(store, 20.3, TriangleBudgetByError{full}, folder / "n.ply");
    REQUIRE(all.triangles == full);
    REQUIRE(all.error_bound == 0);
    REQUIRE(read_file(folder / "n.ply") == read_file(folder / "full.ply"));
    REQUIRE_THROWS_WITH(extract_to(store, 20.3, TriangleBudgetByError{1}, folder / "none.ply"),
                        Catch::Contains(std::to_string(coarsest) + " triangles"));
    REQUIRE_THROWS_AS(extract_to(store, 20.3, TriangleBudgetByError{0}, folder / "none.ply"),
                      Error);
    REQUIRE_FALSE(std::filesystem::exists(folder / "none.ply"));
}
