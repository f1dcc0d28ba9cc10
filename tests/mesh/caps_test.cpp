// Caps of closed surfaces: their place and orientation, values and normals of their vertices, what
// they can be combined with, and where there are none.
#include <catch2/catch.hpp>
#include <cstdint>
#include <map>
#include <set>

#include <isonest/error.h>

#include "query/simplify/patch.h"
#include "tests/mesh/closed_mesh.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

Mesh mesh_of(const MeshCollector& collected) {
    Mesh mesh;
    mesh.vertices = collected.vertices;
    mesh.triangles = collected.triangles;
    return mesh;
}

}  // namespace

TEST_CASE("caps are in the faces and face outward") {
    FunctionVolume<float> volume({17, 18, 17}, smooth_f);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    const WorldBox box{{2, 3.25, 1.5}, {12.75, 14, 40}};
    const Double3 hi{12.75, 14, 16};
    for (const auto& [error, cells] :
         {std::pair{0.0, Cells::tetrahedra}, {0.2, Cells::tetrahedra}, {0.0, Cells::hexahedra}}) {
        for (const Outside outside : {Outside::below, Outside::above}) {
            Settings with{error, box, outside};
            with.cells = cells;
            const Mesh mesh = closed(store, 0.1, with).mesh;
            std::array<int, 6> caps{};
            for (const auto& t : mesh.triangles) {
                const Triangle p = triangle_at(mesh.vertices, t);
                for (std::size_t i = 0; i < 3; ++i) {
                    for (std::size_t a = 0; a < 3; ++a) {
                        CHECK((p[i][a] >= box.lo[a] && p[i][a] <= hi[a]));
                    }
                }
                for (std::size_t a = 0; a < 3; ++a) {
                    const auto in_plane = [&](double x) {
                        return p[0][a] == x && p[1][a] == x && p[2][a] == x;
                    };
                    const std::size_t b = (a + 1) % 3;
                    const std::size_t c = (a + 2) % 3;
                    const double n = (p[1][b] - p[0][b]) * (p[2][c] - p[0][c]) -
                                     (p[1][c] - p[0][c]) * (p[2][b] - p[0][b]);
                    const double out = outside == Outside::below ? n : -n;
                    if (in_plane(box.lo[a])) {
                        ++caps[2 * a];
                        CHECK(out <= 0);
                    } else if (in_plane(hi[a])) {
                        ++caps[2 * a + 1];
                        CHECK(out >= 0);
                    }
                }
            }
            for (const int count : caps) {
                CAPTURE(caps, error, static_cast<int>(outside));
                CHECK(count > 0);
            }
        }
    }
}

TEST_CASE("a closed mesh does not depend on chunks, threads and memory") {
    const auto all_levels = [](const Int3& p) {
        return static_cast<std::uint8_t>(40 + 9 * smooth(p) + 3 * noise(p));
    };
    FunctionVolume<std::uint8_t> volume({40, 37, 45}, all_levels);
    const WorldBox box{{0.5, 3, 7.25}, {33.5, 36, 41}};
    for (const auto& [error, cells] :
         {std::pair{0.0, Cells::tetrahedra}, {3.0, Cells::tetrahedra}, {0.0, Cells::hexahedra}}) {
        for (const double iso : {40.0, 43.5}) {
            std::string first;
            for (const int chunk : {8, 16, 64}) {
                const TemporaryFolder folder;
                make_store(volume, folder / "s", with_chunk(chunk));
                const StoreReader store(folder / "s");
                for (const int threads : {1, 2, 7}) {
                    for (const std::uint64_t memory : {64U << 20U, 1U << 30U}) {
                        const Closed r = closed(
                            store, iso, {error, box, Outside::below, threads, memory, true, cells});
                        if (first.empty()) {
                            require_watertight(r.mesh);
                            first = r.bytes;
                        }
                        CAPTURE(error, iso, chunk, threads, memory);
                        CHECK(r.bytes == first);
                    }
                }
            }
        }
    }
}

TEST_CASE("a closed surface is open only at missing values, and the report says so") {
    const auto f = [](const Int3& p) {
        const bool missing = p == Int3{7, 6, 5} || p == Int3{0, 3, 3};
        return missing ? std::numeric_limits<float>::quiet_NaN() : smooth_f(p);
    };
    FunctionVolume<float> volume({14, 12, 11}, f);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const Store store(folder / "s");
    for (const auto& [error, cells] :
         {std::pair{0.0, Cells::tetrahedra}, {0.3, Cells::tetrahedra}, {0.0, Cells::hexahedra}}) {
        for (const bool components : {false, true}) {
            SurfaceQuery query{.iso = -0.1};
            query.grid.cells = cells;
            query.stop = ErrorBound{error};
            query.stages.close = Outside::below;
            if (components) {
                query.stages.components.emplace();
            }
            MeshCollector mesh;
            const ExtractReport report = extract(store, query, mesh);
            REQUIRE(report.closing);
            CHECK(report.closing->outside == Outside::below);
            std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
            for (const auto& t : mesh.triangles) {
                for (std::size_t i = 0; i < 3; ++i) {
                    ++edges[{t[i], t[(i + 1) % 3]}];
                }
            }
            std::set<std::uint32_t> border;
            for (const auto& [edge, count] : edges) {
                CHECK(count == 1);
                if (edges.count({edge.second, edge.first}) == 0) {
                    for (const std::uint32_t v : {edge.first, edge.second}) {
                        border.insert(v);
                        // Not farther from a missing node than the surrounding cells.
                        const auto near = [&](const Int3& p) {
                            bool all = true;
                            for (std::size_t axis = 0; axis < 3; ++axis) {
                                const auto x = static_cast<double>(mesh.vertices[v][axis]);
                                const auto at = static_cast<double>(p[static_cast<int>(axis)]);
                                all = all && std::fabs(x - at) <= 1;
                            }
                            return all;
                        };
                        CHECK((near({7, 6, 5}) || near({0, 3, 3})));
                    }
                }
            }
            CHECK(!border.empty());
            CHECK(report.closing->border_vertices == border.size());
        }
    }
}

TEST_CASE("what cannot be closed is refused") {
    const TemporaryFolder folder;
    FunctionVolume<float> flat({9, 8, 1}, smooth_f);
    make_store(flat, folder / "flat", with_chunk(8));
    FunctionVolume<float> volume({9, 8, 7}, smooth_f);
    PreprocessOptions options = with_chunk(8);
    options.fields = {Field::deviation_bar, Field::normal_turn_plus};
    make_store(volume, folder / "s", options);
    MeshCollector mesh;
    SurfaceQuery query{.iso = 0};
    query.stages.close = Outside::above;
    CHECK_THROWS_AS(extract(Store(folder / "flat"), query, mesh), Error);
    CHECK_NOTHROW(extract(Store(folder / "s"), query, mesh));
    query.grid.culling = BackfaceCulling{{0, 0, 1}};
    CHECK_THROWS_AS(extract(Store(folder / "s"), query, mesh), Error);
}

TEST_CASE("vertices of caps have the function's value and the direction of its gradient") {
    const Cells cells = GENERATE(Cells::tetrahedra, Cells::hexahedra);
    FunctionVolume<float> volume({14, 17, 12}, smooth_f);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const Store store(folder / "s");
    SurfaceQuery query{.iso = 0.1};
    query.stages.close = Outside::below;
    query.grid.cells = cells;
    query.attributes.normals = true;
    query.attributes.values = &store;
    query.box = WorldBox{{1, 2.25, 3.5}, {9.75, 12.5, 20}};
    MeshCollector mesh;
    extract(store, query, mesh);
    REQUIRE(!mesh.vertices.empty());
    std::size_t above = 0;
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        const Double3 p = point_at(mesh.vertices[v]);
        const double expected =
            cells == Cells::hexahedra ? trilinear(volume, p) : fine_value(volume, p);
        CHECK(mesh.values[v] == Approx(expected).margin(1e-5));
        CHECK(mesh.values[v] > 0.1 - 1e-5);
        above += mesh.values[v] > 0.1 + 1e-5 ? 1 : 0;
        const auto& n = mesh.normals[v];
        CHECK(std::hypot(n[0], n[1], n[2]) == Approx(1).margin(1e-5));
        // A node within the box: central differences.
        const Int3 node{std::llround(p[0]), std::llround(p[1]), std::llround(p[2])};
        const Double3 at{static_cast<double>(node.x), static_cast<double>(node.y),
                         static_cast<double>(node.z)};
        if (p == at && node.z < 11) {
            Double3 g{};
            for (int axis = 0; axis < 3; ++axis) {
                Int3 next = node;
                Int3 before = node;
                ++next[axis];
                --before[axis];
                g[static_cast<std::size_t>(axis)] = volume.at(before) - volume.at(next);
            }
            const double size = std::hypot(g[0], g[1], g[2]);
            for (std::size_t axis = 0; axis < 3; ++axis) {
                CHECK(static_cast<double>(n[axis]) == Approx(g[axis] / size).margin(1e-4));
            }
        }
    }
    CHECK(above > 100);
}

TEST_CASE(
    "a closed surface stays closed within a distance, with a focus or camera, and without its "
    "small components") {
    const auto f = [](const Int3& p) {
        const bool speck = p.x % 6 == 5 && p.y % 6 == 5 && p.z % 6 == 5;
        return speck ? 1.0F : smooth_f(p);
    };
    const Cells cells = GENERATE(Cells::tetrahedra, Cells::hexahedra);
    FunctionVolume<float> volume({24, 21, 26}, f);
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const Store store(folder / "s");
    SurfaceQuery query{.iso = 0.1};
    query.stages.close = Outside::below;
    query.grid.cells = cells;
    query.box = WorldBox{{1, 2.25, 3.5}, {19.75, 20, 30}};
    MeshCollector full;
    extract(store, query, full);
    const double solid = enclosed(mesh_of(full));
    require_watertight(mesh_of(full));
    std::vector<SurfaceQuery> queries(4, query);
    queries[0].stop = DistanceBound{0.2};
    queries[1].stages.components.emplace().largest = 1;
    queries[2].stop = ErrorBound{0.01};
    queries[2].focus = Focus{{4, 4, 4}, {6, 6, 6}, 0.5};
    queries[3].camera = Camera{{-5, 3, 40}, 40, 64, 16};
    if (cells == Cells::hexahedra) {
        // With an error, hexahedral cells have no caps, and they do not support focus or camera.
        queries.resize(2);
    }
    queries.emplace_back(query).stop = DistanceBound{0.2};
    queries.back().effort = Effort::fast;
    queries.emplace_back(query).stop = TriangleBudgetByDistance{full.triangles.size() / 3};
    for (const SurfaceQuery& q : queries) {
        CAPTURE(&q - queries.data());
        MeshCollector mesh;
        const ExtractReport report = extract(store, q, mesh);
        REQUIRE(report.closing);
        CHECK(report.closing->outside == Outside::below);
        CHECK(mesh.triangles.size() < full.triangles.size());
        require_watertight(mesh_of(mesh));
        CHECK(enclosed(mesh_of(mesh)) == Approx(solid).epsilon(0.2));
    }
}
