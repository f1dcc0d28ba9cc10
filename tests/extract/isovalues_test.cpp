// Several isovalues at once: each mesh is the same as for its isovalue alone.
#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <cstring>
#include <nlohmann/json.hpp>

#include <isonest/error.h>
#include <isonest/joined_isovalues.h>
#include <isonest/mesh_file.h>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr std::uint64_t kAmple = std::uint64_t{1} << 30U;
constexpr std::uint64_t kLittle = std::uint64_t{24} << 20U;
/// Simplification needs more.
constexpr std::uint64_t kLittleForStages = std::uint64_t{160} << 20U;

std::string file_of(const char* end, std::size_t i) {
    return fmt::format("{}{}", i, end);
}

/// The files that extract() makes of each isovalue, one after the other.
std::vector<std::string> alone(const Store& store, const std::vector<double>& isovalues,
                               SurfaceQuery query, const char* end) {
    const TemporaryFolder folder;
    std::vector<std::string> files;
    for (std::size_t i = 0; i < isovalues.size(); ++i) {
        query.iso = isovalues[i];
        const auto path = folder.path() / file_of(end, i);
        const auto sink = open_mesh_file(path);
        extract(store, query, *sink);
        files.push_back(read_file(path));
    }
    return files;
}

struct Together {
    std::vector<std::string> files;
    std::vector<std::size_t> order;  ///< in the order in which they were done
    std::size_t at_once = 0;         ///< number of sinks when the first one was done
    std::vector<ExtractReport> reports;
};

Together together(const Store& store, const std::vector<double>& isovalues,
                  const SurfaceQuery& query, const char* end, const ExtractOptions& options) {
    const TemporaryFolder folder;
    Together t;
    std::size_t opened = 0;
    extract_isovalues(
        store, isovalues, query,
        [&](std::size_t i) {
            ++opened;
            return open_mesh_file(folder.path() / file_of(end, i));
        },
        [&](std::size_t i, const ExtractReport& report) {
            t.at_once = t.order.empty() ? opened : t.at_once;
            // It is complete at this point.
            t.files.push_back(read_file(folder.path() / file_of(end, i)));
            t.order.push_back(i);
            t.reports.push_back(report);
        },
        options);
    CHECK(folder.names().size() == isovalues.size());
    return t;
}

/// Compares the meshes for several numbers of threads, with much and with little memory.
void check_same(const Store& store, const std::vector<double>& isovalues, const SurfaceQuery& query,
                const char* end = ".ply", std::uint64_t little = kLittle) {
    const std::vector<std::string> expected = alone(store, isovalues, query, end);
    for (const int threads : {1, 2, 7}) {
        for (const std::uint64_t memory : {little, kAmple}) {
            CAPTURE(threads, memory);
            const Together t = together(store, isovalues, query, end, {memory, threads, {}});
            REQUIRE(t.files.size() == expected.size());
            for (std::size_t i = 0; i < expected.size(); ++i) {
                CAPTURE(isovalues[i]);
                CHECK(t.order[i] == i);
                CHECK(t.files[i] == expected[i]);
            }
        }
    }
}

float waves(const Int3& p) {
    return static_cast<float>(smooth(p) + 0.1 * noise(p));
}

/// Smooth values; odd numbers of nodes.
struct Waves {
    explicit Waves(const Int3& n = {37, 30, 21}, const std::function<float(const Int3&)>& f = waves)
        : volume(n, f) {
        PreprocessOptions options = with_chunk(8);
        options.fields = {Field::deviation_bar, Field::hex_deviation};
        if (n.x == 1 || n.y == 1 || n.z == 1) {
            options.fields = {Field::deviation_bar};
        }
        make_store(volume, folder / "s", options);
        store.emplace(folder / "s");
    }
    TemporaryFolder folder;
    FunctionVolume<float> volume;
    std::optional<Store> store;
};

}  // namespace

TEST_CASE("isovalues of bytes extracted together give the bytes of each alone") {
    const TemporaryFolder folder;
    FunctionVolume<std::uint8_t> volume({33, 41, 22}, [](const Int3& p) {
        return static_cast<std::uint8_t>(std::lround(100 + 30 * smooth(p) + 5 * noise(p)));
    });
    make_store(volume, folder / "s", with_chunk(16));
    // Values of nodes and others, in no order, and one beyond all values.
    check_same(Store(folder / "s"), {120, 80.5, 100, 255, 60}, {});
}

TEST_CASE("isovalues of floats extracted together give the bytes of each alone, for all options") {
    const Waves subject;
    const Store& store = *subject.store;
    const std::vector<double> isovalues{0.4, -0.3, 1.0};
    SurfaceQuery query;
    SECTION("full resolution, with attributes") {
        query.attributes = {true, nullptr, Field::deviation_bar};
        check_same(store, isovalues, query, ".vtp");
    }
    SECTION("an error") {
        query.stop = ErrorBound{0.2};
        query.effort = Effort::none;
        check_same(store, isovalues, query);
    }
    SECTION("a distance") {
        query.stop = DistanceBound{0.4};
        check_same(store, isovalues, query, ".ply", kLittleForStages);
    }
    SECTION("an error, simplified") {
        query.stop = ErrorBound{0.2};
        query.effort = Effort::best;
        check_same(store, isovalues, query, ".ply", kLittleForStages);
    }
    SECTION("a number of triangles by the error, with a separate search for each isovalue") {
        query.stop = TriangleBudgetByError{800};
        query.effort = Effort::none;
        check_same(store, isovalues, query);
    }
    SECTION("closed, without small components, in a box") {
        query.stages = {Outside::below, ComponentChoice{0, 20, 0}};
        query.box = WorldBox{{2.5, 0, 1}, {30, 25.25, 17}};
        check_same(store, isovalues, query);
    }
    SECTION("hexahedral cells") {
        query.grid.cells = Cells::hexahedra;
        query.stop = ErrorBound{0.1};
        query.effort = Effort::none;
        check_same(store, isovalues, query, ".stl");
    }
    SECTION("exact vertices") {
        query.grid.vertices = VertexPlace::exact;
        query.stop = ErrorBound{0.2};
        query.effort = Effort::none;
        check_same(store, isovalues, query);
    }
}

TEST_CASE("isovalues beside missing values extracted together give the bytes of each alone") {
    const Waves subject({30, 25, 19}, [](const Int3& p) {
        return noise(p, 5) < 0.01 ? std::numeric_limits<float>::quiet_NaN() : waves(p);
    });
    check_same(*subject.store, {0.4, -0.3, 1.0}, {});
}

TEST_CASE("isolines extracted together give the bytes of each alone") {
    for (const Int3& n : {Int3{61, 45, 1}, Int3{1, 50, 37}}) {
        const Waves subject(n);
        SurfaceQuery query;
        check_same(*subject.store, {0.4, -0.3, 1.0}, query, ".vtp");
        query.stop = ErrorBound{0.1};
        check_same(*subject.store, {0.4, -0.3, 1.0}, query, ".obj");
        query.stop = DistanceBound{0.3};
        check_same(*subject.store, {0.4, -0.3, 1.0}, query, ".vtp");
    }
}

TEST_CASE("many isovalues share reads, and fewer of them if memory is short") {
    const Waves subject({33, 29, 30});
    std::vector<double> isovalues;
    for (int i = 0; i < 24; ++i) {
        isovalues.push_back(-1 + 0.1 * i);
    }
    const std::vector<std::string> expected = alone(*subject.store, isovalues, {}, ".ply");
    const Together ample = together(*subject.store, isovalues, {}, ".ply", {kAmple, 2, {}});
    CHECK(ample.files == expected);
    CHECK(ample.at_once == isovalues.size());
    for (const ExtractReport& r : ample.reports) {
        CHECK(r.traversal.chunks_read == ample.reports.front().traversal.chunks_read);
        CHECK(r.traversal.chunks_read <= r.traversal.chunks_total);
    }
    const Together little = together(*subject.store, isovalues, {}, ".ply", {kLittle, 2, {}});
    CHECK(little.files == expected);
    CHECK(little.at_once < isovalues.size());
}

TEST_CASE("the report of each isovalue is the same as alone, except for shared counts") {
    const Waves subject;
    SurfaceQuery query;
    query.stop = ErrorBound{0.1};
    query.effort = Effort::none;
    const std::vector<double> isovalues{0.4, -0.3, 9.0};
    ExtractOptions options;
    options.quality = true;
    const Together t = together(*subject.store, isovalues, query, ".ply", options);
    for (std::size_t i = 0; i < isovalues.size(); ++i) {
        query.iso = isovalues[i];
        MeshCollector mesh;
        const ExtractReport own = extract(*subject.store, query, mesh, options);
        CAPTURE(isovalues[i]);
        CHECK(t.reports[i].triangles == own.triangles);
        CHECK(t.reports[i].vertices == own.vertices);
        CHECK(t.reports[i].error_bound == own.error_bound);
        CHECK(t.reports[i].mending.zero_area == own.mending.zero_area);
        CHECK(t.reports[i].quality->least == own.quality->least);
    }
    CHECK(t.reports[2].triangles == 0);
}

TEST_CASE("invalid lists of isovalues are refused before anything is written") {
    const Waves subject({9, 9, 9});
    const auto message = [&](const std::vector<double>& isovalues, ErrorKind kind) {
        const TemporaryFolder folder;
        std::string said;
        try {
            extract_isovalues(
                *subject.store, isovalues, {},
                [&](std::size_t i) { return open_mesh_file(folder.path() / file_of(".ply", i)); },
                [](std::size_t, const ExtractReport&) { FAIL("a mesh was made"); });
        } catch (const Error& error) {
            CHECK(error.kind() == kind);
            said = error.what();
        }
        CHECK(folder.names().empty());
        return said;
    };
    using Catch::Matchers::Contains;
    CHECK_THAT(message({}, ErrorKind::invalid_argument), Contains("no isovalues are given"));
    CHECK_THAT(message({0.5, 1, 0.5}, ErrorKind::invalid_argument), Contains("0.5 is given twice"));
    CHECK_THAT(message({0.0, -0.0}, ErrorKind::invalid_argument), Contains("is given twice"));
    std::vector<double> many(kMaxIsovalues + 1);
    for (std::size_t i = 0; i < many.size(); ++i) {
        many[i] = 0.01 * static_cast<double>(i);
    }
    CHECK_THAT(message(many, ErrorKind::limit), Contains("257 isovalues") && Contains("256"));
    CHECK(!message({0.5, std::numeric_limits<double>::quiet_NaN()}, ErrorKind::invalid_argument)
               .empty());
}

TEST_CASE("the isovalues finished before a failure are kept") {
    const Waves subject;
    const TemporaryFolder folder;
    std::vector<std::size_t> finished;
    const auto run = [&] {
        extract_isovalues(
            *subject.store, std::vector<double>{0.4, -0.3, 1.0}, {},
            [&](std::size_t i) { return open_mesh_file(folder.path() / file_of(".ply", i)); },
            [&](std::size_t i, const ExtractReport&) {
                finished.push_back(i);
                if (i == 1) {
                    throw std::runtime_error("enough");
                }
            });
    };
    CHECK_THROWS_WITH(run(), "enough");
    CHECK(finished == std::vector<std::size_t>{0, 1});
    CHECK(folder.names().size() == 2);
}

namespace {

/// The result for a joined mesh, split into the mesh of each isovalue.
struct Joined {
    std::vector<Mesh> meshes;  ///< by isovalue
    bool is_double = false;
    std::string file;
};

Joined joined(const Store& store, const std::vector<double>& isovalues, const SurfaceQuery& query,
              const ExtractOptions& options) {
    const TemporaryFolder folder;
    const auto path = folder / "all.ply";
    std::vector<std::size_t> order;
    {
        const auto sink = open_mesh_file(path);
        extract_joined(
            store, isovalues, query, *sink,
            [&](std::size_t i, const ExtractReport&) { order.push_back(i); }, options);
    }
    CHECK(order.size() == isovalues.size());
    Joined result;
    result.file = read_file(path);
    result.is_double = result.file.find("property double isovalue\n") != std::string::npos;
    CHECK((result.is_double || result.file.find("property float isovalue\n") != std::string::npos));
    const Mesh all = read_mesh(path);
    std::size_t vertex = 0;
    std::size_t triangle = 0;
    for (const double isovalue : isovalues) {
        const double stored =
            result.is_double ? isovalue : static_cast<double>(static_cast<float>(isovalue));
        Mesh& mesh = result.meshes.emplace_back();
        const std::size_t first = vertex;
        for (; vertex < all.vertices.size() && all.attributes[vertex].back() == stored; ++vertex) {
            mesh.vertices.push_back(all.vertices[vertex]);
            mesh.attributes.emplace_back(all.attributes[vertex].begin(),
                                         all.attributes[vertex].end() - 1);
        }
        for (; triangle < all.triangles.size() && all.triangles[triangle][0] < vertex; ++triangle) {
            const auto& t = all.triangles[triangle];
            mesh.triangles.push_back({static_cast<std::uint32_t>(t[0] - first),
                                      static_cast<std::uint32_t>(t[1] - first),
                                      static_cast<std::uint32_t>(t[2] - first)});
        }
    }
    CHECK(vertex == all.vertices.size());
    CHECK(triangle == all.triangles.size());
    return result;
}

void check_joined(const Store& store, const std::vector<double>& isovalues, SurfaceQuery query) {
    std::string file;
    for (const ExtractOptions& options :
         {ExtractOptions{kAmple, 1, {}}, ExtractOptions{kLittleForStages, 7, {}}}) {
        const Joined all = joined(store, isovalues, query, options);
        REQUIRE(all.meshes.size() == isovalues.size());
        for (std::size_t i = 0; i < isovalues.size(); ++i) {
            CAPTURE(isovalues[i]);
            const TemporaryFolder folder;
            query.iso = isovalues[i];
            extract(store, query, *open_mesh_file(folder / "m.ply"));
            const Mesh own = read_mesh(folder / "m.ply");
            CHECK(all.meshes[i].vertices == own.vertices);
            CHECK(all.meshes[i].attributes == own.attributes);
            CHECK(all.meshes[i].triangles == own.triangles);
        }
        CHECK((file.empty() || file == all.file));
        file = all.file;
    }
}

}  // namespace

TEST_CASE("a joined mesh contains the mesh of each isovalue, one after the other") {
    const Waves subject;
    SurfaceQuery query;
    SECTION("full resolution, with normals, and an isovalue without surface in between") {
        query.attributes.normals = true;
        check_joined(*subject.store, {0.5, 9, -0.25, 1}, query);
    }
    SECTION("simplified, in float64") {
        query.stop = DistanceBound{0.4};
        check_joined(*subject.store, {0.4, -0.3}, query);
    }
    SECTION("a search for each isovalue") {
        query.stop = TriangleBudgetByError{800};
        check_joined(*subject.store, {0.5, -0.25}, query);
    }
}

TEST_CASE("a joined mesh stores the isovalue as float32 if that is exact") {
    const Waves subject({17, 15, 13});
    CHECK(!joined(*subject.store, {0.5, -0.25}, {}, {}).is_double);
    CHECK(joined(*subject.store, {0.5, 0.3}, {}, {}).is_double);
}

TEST_CASE("a joined mesh serves sinks that request the vertices of each element") {
    const Waves subject({17, 15, 13});
    const std::vector<double> isovalues{0.5, -0.25, 1};
    std::string triangles;
    for (const std::string& file : alone(*subject.store, isovalues, {}, ".stl")) {
        triangles += file.substr(84);
    }
    const TemporaryFolder folder;
    extract_joined(*subject.store, isovalues, {}, *open_mesh_file(folder / "all.stl"),
                   [](std::size_t, const ExtractReport&) {});
    CHECK(read_file(folder / "all.stl").substr(84) == triangles);
}

TEST_CASE("a joined mesh in glTF has the isovalue of each vertex as float32") {
    const Waves subject({17, 15, 13});
    const std::vector<double> isovalues{0.5, 0.3};
    const TemporaryFolder folder;
    extract_joined(*subject.store, isovalues, {}, *open_mesh_file(folder / "all.glb"),
                   [](std::size_t, const ExtractReport&) {});
    const std::string file = read_file(folder / "all.glb");
    std::uint32_t json_bytes = 0;
    std::memcpy(&json_bytes, file.data() + 12, sizeof(json_bytes));
    const auto json = nlohmann::json::parse(file.substr(20, json_bytes));
    const auto& accessor =
        json["accessors"]
            [json["meshes"][0]["primitives"][0]["attributes"].at("_ISOVALUE").get<std::size_t>()];
    const std::size_t at =
        28 + json_bytes +
        json["bufferViews"][accessor["bufferView"].get<std::size_t>()]["byteOffset"]
            .get<std::size_t>();
    std::vector<float> expected;
    for (const double isovalue : isovalues) {
        SurfaceQuery query;
        query.iso = isovalue;
        MeshCollector own;
        extract(*subject.store, query, own);
        expected.insert(expected.end(), own.vertices.size(), static_cast<float>(isovalue));
    }
    REQUIRE(accessor["count"] == expected.size());
    std::vector<float> found(expected.size());
    std::memcpy(found.data(), file.data() + at, found.size() * sizeof(float));
    CHECK(found == expected);
}

TEST_CASE("a joined mesh of isolines contains those of each isovalue") {
    const Waves subject({61, 45, 1});
    const std::vector<double> isovalues{0.5, -0.25, 1};
    const TemporaryFolder folder;
    extract_joined(*subject.store, isovalues, {}, *open_mesh_file(folder / "all.obj"),
                   [](std::size_t, const ExtractReport&) {});
    const Lines all = read_lines(folder / "all.obj");
    std::vector<Double3> points;
    std::vector<std::array<std::size_t, 2>> segments;
    for (const double isovalue : isovalues) {
        SurfaceQuery query;
        query.iso = isovalue;
        extract(*subject.store, query, *open_mesh_file(folder / "l.obj", {.replace = true}));
        const Lines own = read_lines(folder / "l.obj");
        for (const auto& s : own.segments) {
            segments.push_back({s[0] + points.size(), s[1] + points.size()});
        }
        points.insert(points.end(), own.points.begin(), own.points.end());
    }
    CHECK(!segments.empty());
    CHECK(all.points == points);
    CHECK(all.segments == segments);
}

TEST_CASE("a joined mesh is written completely or not at all") {
    const Waves subject({17, 15, 13});
    const TemporaryFolder folder;
    const auto sink = open_mesh_file(folder / "all.ply");
    CHECK_THROWS_WITH(extract_joined(*subject.store, std::vector<double>{0.5, -0.25}, {}, *sink,
                                     [](std::size_t i, const ExtractReport&) {
                                         if (i == 1) {
                                             throw std::runtime_error("enough");
                                         }
                                     }),
                      "enough");
    CHECK(folder.names().empty());
}
