// The graph over adaptive quadrilaterals: no cracks, the values of the projection, within the
// error.
#include <catch2/catch.hpp>

#include <isonest/error.h>

#include "tests/support/cell_oracle.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

double rough(const Int3& p) {
    return smooth(p) + 0.3 * noise(p);
}
/// Smooth except in one corner: cells of all sizes.
double graded(const Int3& p) {
    const double far = std::hypot(static_cast<double>(p.x), static_cast<double>(p.y));
    return 0.001 * static_cast<double>(p.x * p.y) + noise(p) * std::exp(-far / 3);
}

struct Result {
    Mesh mesh;
    std::string bytes;
    ExtractReport report;
};

Result graph_of(FunctionVolume<double>& volume, double error,
                const std::function<void(Extraction&)>& ask = {}, int chunk = 8) {
    const TemporaryFolder folder;
    PreprocessOptions options = with_chunk(chunk, true);
    options.fields = {Field::hex_linf, Field::hex_deviation};
    make_store(volume, folder / "s", options);
    const StoreReader store(folder / "s");
    Extraction e;
    e.graph_scale = 1;
    e.cells = Cells::hexahedra;
    e.error = error;
    e.threads = 2;
    if (ask) {
        ask(e);
    }
    Result r;
    r.report = extract(store, folder / "m.ply", e, silent_progress());
    r.bytes = read_file(folder / "m.ply");
    r.mesh = read_mesh(folder / "m.ply");
    return r;
}

double plan_area(const Mesh& mesh) {
    double sum = 0;
    for (const auto& t : mesh.triangles) {
        const auto& a = mesh.vertices[t[0]];
        const auto& b = mesh.vertices[t[1]];
        const auto& c = mesh.vertices[t[2]];
        const double twice = static_cast<double>(b[0] - a[0]) * static_cast<double>(c[1] - a[1]) -
                             static_cast<double>(b[1] - a[1]) * static_cast<double>(c[0] - a[0]);
        CHECK(twice > 0);  // it faces upward
        sum += twice / 2;
    }
    return sum;
}

}  // namespace

TEST_CASE("the graph over quadrilaterals has no cracks and the values of the projection") {
    int halved = 0;
    for (const Int3& n : {Int3{33, 33, 1}, Int3{17, 33, 1}, Int3{21, 14, 1}, Int3{2, 2, 1}}) {
        for (const auto function : {rough, graded}) {
            FunctionVolume<double> volume(n, function);
            const std::vector<CellNumbers> numbers = cell_numbers_by_loops(volume, Lattice(n));
            for (const double error : {0.0, 0.02, 0.1, 0.5, 2.0}) {
                CAPTURE(n.x, n.y, error);
                const Result r = graph_of(volume, error);
                CHECK(plan_area(r.mesh) == Approx(static_cast<double>((n.x - 1) * (n.y - 1))));
                const MeshFaults faults =
                    check_mesh(r.mesh, {0, 0, -1e9},
                               {static_cast<double>(n.x - 1), static_cast<double>(n.y - 1), 1e9});
                CHECK(faults.open_edges_inside == 0);
                CHECK(faults.overused_edges == 0);
                CHECK(faults.misoriented_edges == 0);
                CHECK(faults.flat_triangles == 0);
                CHECK(faults.unused_vertices == 0);

                CellGridByList grid(volume, numbers, true, error);
                const double most = grid.measure().linf;
                CHECK((error == 0 ? most == 0 : most < error));
                CHECK(most <= r.report.error_bound * (1 + 1e-6));
                std::size_t wrong = 0;
                for (const auto& v : r.mesh.vertices) {
                    const Int3 p{std::lround(v[0]), std::lround(v[1]), 0};
                    const bool at_node =
                        static_cast<float>(p.x) == v[0] && static_cast<float>(p.y) == v[1];
                    const bool at_border = p.x == n.x - 1 || p.y == n.y - 1;
                    REQUIRE((at_node || at_border));  // clipped there
                    wrong +=
                        !at_border && std::fabs(static_cast<double>(v[2]) - grid.value(p)) > 1e-6
                            ? 1
                            : 0;
                }
                CHECK(wrong == 0);
                if (n == Int3{33, 33, 1}) {  // no cell extends beyond the volume
                    std::size_t triangles = 0;
                    for (const int edges : grid.halved_edges()) {
                        triangles += edges == 0 ? 2 : static_cast<std::size_t>(4 + edges);
                        halved += edges;
                    }
                    CHECK(r.mesh.triangles.size() == triangles);
                }
            }
        }
    }
    CHECK(halved > 50);
}

TEST_CASE("the graph over quadrilaterals has the same bytes for any chunks, threads and memory") {
    FunctionVolume<double> volume({150, 131, 1}, graded);
    const auto by = [&](int chunk, int threads, std::uint64_t memory) {
        return graph_of(
                   volume, 0.01,
                   [&](Extraction& e) {
                       e.threads = threads;
                       e.memory = memory;
                       e.normals = true;
                       e.box = WorldBox{{3.5, 2, -1e9}, {140, 120.25, 1e9}};
                   },
                   chunk)
            .bytes;
    };
    const std::string bytes = by(8, 2, 1U << 30U);
    CHECK(bytes.size() > 1000);
    CHECK(bytes == by(16, 1, 1U << 30U));
    CHECK(bytes == by(8, 1, 40U << 20U));
}

TEST_CASE("missing values remove single cells from the graph over quadrilaterals") {
    FunctionVolume<double> volume({33, 33, 1}, [](const Int3& p) {
        return p == Int3{16, 16, 0} || p == Int3{3, 20, 0}
                   ? std::numeric_limits<double>::quiet_NaN()
                   : 0.01 * static_cast<double>(p.x);
    });
    CHECK(plan_area(graph_of(volume, 0.1).mesh) == Approx(32 * 32 - 8));
    CHECK(plan_area(graph_of(volume, 0).mesh) == Approx(32 * 32 - 8));
}

TEST_CASE("the graph over quadrilaterals refuses what it does not support") {
    const TemporaryFolder folder;
    FunctionVolume<double> volume({9, 9, 1}, rough);
    make_store(volume, folder / "s");
    const StoreReader store(folder / "s");
    GraphQuery query;
    query.cells = Cells::hexahedra;
    REQUIRE_NOTHROW(extract_query(store, query, false));
    query.stop = ErrorBound{0.1};
    REQUIRE_THROWS_WITH(extract_query(store, query, false), Catch::Contains("hex_deviation"));
    query.stop = FieldThreshold{Field::deviation_bar, 0.1};
    REQUIRE_THROWS_WITH(extract_query(store, query, false), Catch::Contains("field of cells"));
    query.stop = {};
    query.focus.emplace();
    REQUIRE_THROWS_WITH(extract_query(store, query, false), Catch::Contains("focus"));
}
