// A volume is extracted without a store: the mesh is that of march_hexahedra(), however it is
// divided into parts; and the stages on it.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>
#include <numbers>
#include <string>
#include <tuple>
#include <vector>

#include <isonest/error.h>
#include <isonest/march.h>
#include <isonest/mesh_file.h>
#include <isonest/preprocess.h>

#include "query/mesh/part_store.h"
#include "query/mesh/weld.h"
#include "query/slabs/join_slabs.h"
#include "query/slabs/march_slab.h"
#include "tests/support/test_support.h"
#include "tests/support/whole_mesh.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

bool same_mesh(const MeshCollector& a, const MeshCollector& b) {
    return a.vertices == b.vertices && a.triangles == b.triangles && a.normals == b.normals;
}

/// Parts use gradients as normals. Where the gradient is 0, the whole mesh uses the normal of the
/// surrounding triangles instead.
bool same_gradients(const MeshCollector& parts, const MeshCollector& whole) {
    bool is_same = parts.normals.size() == whole.normals.size();
    for (std::size_t v = 0; is_same && v < parts.normals.size(); ++v) {
        const auto& n = parts.normals[v];
        is_same = n == whole.normals[v] || (n[0] == 0 && n[1] == 0 && n[2] == 0);
    }
    return is_same;
}

/// Marched by one marcher, in slabs of `layers` layers and parts of a maximum weight, and then
/// welded.
void march_in_parts(MeshCollector& mesh, VolumeSource& volume, double iso, std::int64_t layers,
                    std::size_t most) {
    const VolumeDescription d = volume.describe();
    const TemporaryFolder folder;
    const SlabPlace place{iso, true, d.spacing, d.origin};
    PartStore parts(folder.path(), d.spacing, d.origin, 1000, 3);
    SlabReader reader(volume);
    const auto marcher = make_slab_marcher(d.type, d.nodes, place);
    for (std::int64_t z = 0; marcher && z + 1 < d.nodes.z; z += layers) {
        const Slab slab{z, std::min(z + layers, d.nodes.z - 1)};
        marcher->march_parts(reader.read(slab), slab, most,
                             [&](std::uint64_t order, MarchedSlab&& part) {
                                 parts.append(order, part_of(std::move(part)));
                             });
    }
    parts.seal();
    AttributeChoice attributes;
    attributes.normal = true;
    const Weld weld(parts, folder.path());
    const MeshLayout layout = layout_of(attributes, 3, {}, {});
    emit_mesh(parts, weld, layout, mesh, silent_progress());
    // The same, while the parts are released.
    ScratchMesh moved(folder.path());
    move_mesh(parts, weld, layout, moved, silent_progress());
    MeshCollector again;
    again.begin(moved.layout());
    emit_vertices(moved, again, silent_progress());
    emit_elements(moved, again, silent_progress());
    REQUIRE(again.vertices == mesh.vertices);
    REQUIRE(again.triangles == mesh.triangles);
    REQUIRE(again.normals == mesh.normals);
}

ExtractReport extract_volume(VolumeSource& volume, const SurfaceQuery& query, MeshCollector& mesh,
                             int threads = 0, std::uint64_t memory = std::uint64_t{1} << 30U) {
    ExtractOptions options;
    options.threads = threads;
    options.memory = memory;
    return extract(volume, query, mesh, options);
}

SurfaceQuery at(double iso) {
    SurfaceQuery query;
    query.iso = iso;
    query.attributes.normals = true;
    return query;
}

template <class T>
void check_volume(const Int3& nodes, double iso, const std::function<T(const Int3&)>& f) {
    FunctionVolume<T> volume(nodes, f);
    volume.spacing_ = {0.5, 1.25, 2};
    CAPTURE(nodes.x, nodes.y, nodes.z, iso, name_of(value_type_of<T>));
    MeshCollector whole;
    const ExtractReport marched = march_hexahedra(volume, {iso, true}, whole);
    MeshCollector mesh;
    const ExtractReport report = extract_volume(volume, at(iso), mesh, 2);
    CHECK(same_mesh(mesh, whole));
    CHECK(report.vertices == marched.vertices);
    CHECK(report.triangles == marched.triangles);
    CHECK(report.value_range == marched.value_range);
    CHECK(report.coordinate_rounding == marched.coordinate_rounding);
    CHECK(report.traversal.leaves == marched.traversal.leaves);
    CHECK(report.mending.mended == marched.mending.mended);
    CHECK(report.measures->area == Approx(marched.measures->area));
    CHECK(report.measures->volume.has_value() == marched.measures->volume.has_value());
    CHECK(report.apart.moved == marched.apart.moved);
    if (marched.mending.mended == 0) {
        for (const std::size_t most : {1, 7, 60}) {
            for (const std::int64_t layers : {1, 3, 100}) {
                CAPTURE(most, layers);
                MeshCollector parts;
                march_in_parts(parts, volume, iso, layers, most);
                // Marching alone does not move vertices apart.
                CHECK(parts.triangles == whole.triangles);
                if (marched.apart.moved == 0) {
                    CHECK(parts.vertices == whole.vertices);
                    CHECK(same_gradients(parts, whole));
                }
            }
        }
    }
}

template <class T>
T plateaus(const Int3& p) {
    return static_cast<T>(4 * noise(p));
}
template <class T>
T waves(const Int3& p) {
    return static_cast<T>(20 * (smooth(p) + 2.5) + 5 * noise(p));
}

float ball(const Int3& p) {
    return static_cast<float>(18 - std::hypot(p.x - 20.0, p.y - 19.0, p.z - 21.5));
}

}  // namespace

TEST_CASE("The mesh of a volume does not depend on how it is divided into slabs and parts") {
    for (const Int3& nodes : {Int3{2, 2, 2}, Int3{2, 9, 5}, Int3{40, 2, 3}, Int3{3, 2, 40},
                              Int3{65, 4, 6}, Int3{17, 19, 21}}) {
        check_volume<std::uint8_t>(nodes, 50.5, waves<std::uint8_t>);
        check_volume<float>(nodes, 50, waves<float>);
        check_volume<std::int16_t>(nodes, 2, plateaus<std::int16_t>);
        check_volume<double>(nodes, 1.5, plateaus<double>);
    }
}

TEST_CASE("Missing values and constant volumes give the same mesh in parts") {
    const float nan = std::numeric_limits<float>::quiet_NaN();
    for (const Int3& nodes : {Int3{2, 2, 2}, Int3{17, 19, 21}}) {
        check_volume<float>(
            nodes, 2, [&](const Int3& p) { return noise(p, 3) < 0.1 ? nan : plateaus<float>(p); });
        check_volume<float>(nodes, 2, [&](const Int3&) { return nan; });
        check_volume<float>(nodes, 2, [](const Int3&) { return 2.0F; });
        check_volume<std::uint8_t>(nodes, 300, plateaus<std::uint8_t>);
    }
}

TEST_CASE("The mesh of a volume has the same bytes for any threads and memory") {
    FunctionVolume<std::uint8_t> volume({60, 61, 62}, plateaus<std::uint8_t>);
    volume.granularity_ = {4, 2};
    const std::uint64_t least = [&] {
        for (std::uint64_t memory = std::uint64_t{8} << 20U;; memory += std::uint64_t{1} << 18U) {
            try {
                MeshCollector mesh;
                extract_volume(volume, at(2), mesh, 1, memory);
                return memory;
            } catch (const Error& error) {
                REQUIRE(error.kind() == ErrorKind::limit);
            }
        }
    }();
    MeshCollector one;
    const ExtractReport report = extract_volume(volume, at(2), one, 1);
    CHECK(report.triangles > 100000);
    for (const int threads : {1, 2, 7}) {
        for (const std::uint64_t memory :
             {least, least + (std::uint64_t{4} << 20U), std::uint64_t{1} << 28U}) {
            CAPTURE(threads, memory);
            MeshCollector mesh;
            extract_volume(volume, at(2), mesh, threads, memory);
            CHECK(same_mesh(mesh, one));
        }
    }
}

TEST_CASE("A mesh marched without a store is simplified and filtered like one from a store") {
    FunctionVolume<float> volume({44, 45, 46}, [](const Int3& p) {
        return std::max(ball(p), 2 - std::hypot(p.x - 3.0F, p.y - 40.0F, p.z - 3.0F));
    });
    SurfaceQuery query = at(0.25);
    query.attributes.normals = false;
    query.stages.components = ComponentChoice{.largest = 1};
    MeshCollector full;
    const ExtractReport whole = extract_volume(volume, query, full);
    REQUIRE(whole.components);
    CHECK(whole.components->components == 2);
    CHECK(whole.components->dropped == 1);
    CHECK(whole.measures->volume.has_value());
    for (const Effort effort : {Effort::best, Effort::fast}) {
        query.stop = DistanceBound{0.5, true};
        query.effort = effort;
        MeshCollector mesh;
        const ExtractReport report = extract_volume(volume, query, mesh, 1);
        REQUIRE(report.distance);
        CHECK(report.distance->bound <= 0.5);
        CHECK(report.distance->asked == 0.5);
        CHECK(report.distance->full_triangles ==
              whole.triangles + whole.components->dropped_triangles);
        CHECK(report.triangles < whole.triangles / 4);
        require_whole({mesh.vertices, {}, mesh.triangles}, {0, 0, 0}, {43, 44, 45});
        for (const int threads : {2, 7}) {
            MeshCollector other;
            extract_volume(volume, query, other, threads, std::uint64_t{1} << 27U);
            CHECK(same_mesh(mesh, other));
        }
        query.stop = TriangleBudgetByDistance{200};
        query.effort = effort;
        MeshCollector few;
        CHECK(extract_volume(volume, query, few).triangles <= 200);
    }
}

TEST_CASE("A simplified surface needs little temporary space, and the report says how much") {
    const double w = 2 * std::numbers::pi / 40;
    FunctionVolume<float> volume({113, 120, 131}, [&](const Int3& p) {
        const double x = w * static_cast<double>(p.x) + 0.3;
        const double y = w * static_cast<double>(p.y) + 0.7;
        const double z = w * static_cast<double>(p.z) + 0.1;
        return static_cast<float>(std::sin(x) * std::cos(y) + std::sin(y) * std::cos(z) +
                                  std::sin(z) * std::cos(x));
    });
    constexpr std::uint64_t kMemory = std::uint64_t{60} << 20U;  // too little for the parts
    const auto [effort, limit, most] = GENERATE(table<Effort, double, std::uint64_t>(
        {{Effort::fast, 0.5, 30}, {Effort::fast, 0.01, 90}, {Effort::best, 0.5, 60}}));
    SurfaceQuery query;
    query.stop = DistanceBound{limit, true};
    query.effort = effort;
    MeshCollector mesh;
    const ExtractReport report = extract_volume(volume, query, mesh, 2, kMemory);
    const std::uint64_t full = report.distance->full_triangles;
    CAPTURE(full, report.triangles, report.scratch_bytes);
    CHECK(full > 200000);
    // Corners and vertices of the full surface are stored there in any case.
    CHECK(report.scratch_bytes > 18 * full);
    CHECK(report.scratch_bytes < most * full);
}

TEST_CASE("A rotated volume is marched in its own axes") {
    FunctionVolume<float> volume({44, 45, 46}, ball);
    MeshCollector straight;
    const ExtractReport along = extract_volume(volume, at(0.25), straight);
    class Turned : public FunctionVolume<float> {
      public:
        using FunctionVolume<float>::FunctionVolume;
        [[nodiscard]] VolumeDescription describe() const override {
            VolumeDescription d = FunctionVolume<float>::describe();
            d.direction = {Double3{0, 1, 0}, Double3{-1, 0, 0}, Double3{0, 0, 1}};
            return d;
        }
    } turned({44, 45, 46}, ball);
    MeshCollector mesh;
    const ExtractReport report = extract_volume(turned, at(0.25), mesh);
    REQUIRE(mesh.vertices.size() == straight.vertices.size());
    CHECK(mesh.triangles == straight.triangles);
    CHECK(report.measures->area == Approx(along.measures->area));
    for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
        CHECK(mesh.vertices[i][0] == Approx(-straight.vertices[i][1]));
        CHECK(mesh.vertices[i][1] == Approx(straight.vertices[i][0]));
    }
    const TemporaryFolder folder;
    preprocess(turned, folder / "s", with_chunk(16), silent_progress());
    SurfaceQuery query = at(0.25);
    query.grid.cells = Cells::hexahedra;
    MeshCollector stored;
    extract(Store(folder / "s"), query, stored);
    auto a = mesh.vertices;
    auto b = stored.vertices;
    std::sort(a.begin(), a.end());
    std::sort(b.begin(), b.end());
    CHECK(a == b);
}

TEST_CASE("A volume whose directions are not a valid lattice is refused") {
    class Directed : public FunctionVolume<float> {
      public:
        Directed(const Int3& nodes, const Directions& direction)
            : FunctionVolume<float>(nodes, ball), direction_(direction) {}
        [[nodiscard]] VolumeDescription describe() const override {
            VolumeDescription d = FunctionVolume<float>::describe();
            d.direction = direction_;
            return d;
        }

      private:
        Directions direction_;
    };
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    const Directions left{Double3{1, 0, 0}, Double3{0, 1, 0}, Double3{0, 0, -1}};
    const Directions longer{Double3{2, 0, 0}, Double3{0, 1, 0}, Double3{0, 0, 1}};
    const Directions in_plane{Double3{1, 0, 0}, Double3{0, 1, 0}, Double3{0.6, 0.8, 0}};
    const Directions missing{Double3{1, 0, 0}, Double3{0, kNone, 0}, Double3{0, 0, 1}};
    const Directions tilted{Double3{1, 0, 0}, Double3{0, 1, 0}, Double3{0, 0.6, 0.8}};
    const TemporaryFolder folder;
    for (const Directions& direction : {left, longer, in_plane, missing}) {
        Directed volume({9, 9, 9}, direction);
        MeshCollector mesh;
        REQUIRE_THROWS_WITH(extract_volume(volume, at(0.25), mesh), Catch::Contains("directions"));
        REQUIRE_THROWS_WITH(preprocess(volume, folder / "s", with_chunk(16), silent_progress()),
                            Catch::Contains("directions"));
    }
    Directed tilted_volume({9, 9, 9}, tilted);
    MeshCollector mesh;
    REQUIRE_NOTHROW(extract_volume(tilted_volume, at(0.25), mesh));
    // The third axis of a single plane must be perpendicular to it.
    Directed plane({9, 9, 1}, tilted);
    REQUIRE_THROWS_WITH(preprocess(plane, folder / "s", with_chunk(16), silent_progress()),
                        Catch::Contains("one node"));
    // Right angles up to rounding do not count as shear.
    Directions rounded{Double3{1, 0, 0}, Double3{0, 1, 0}, Double3{0, 1e-11, 1}};
    Directed nearly({9, 9, 1}, rounded);
    REQUIRE_NOTHROW(preprocess(nearly, folder / "s", with_chunk(16), silent_progress()));
}

TEST_CASE("Queries that need a store are refused, and the message says how to make one") {
    FunctionVolume<float> volume({9, 9, 9}, ball);
    const auto refused = [&](const std::function<void(SurfaceQuery&)>& ask) {
        SurfaceQuery query = at(0.25);
        ask(query);
        const bool has_memory = march_memory(volume, query).has_value();
        try {
            MeshCollector mesh;
            extract_volume(volume, query, mesh);
            CHECK(has_memory);
        } catch (const Error& error) {
            CHECK_FALSE(has_memory);
            return error.kind() == ErrorKind::invalid_argument &&
                   error.remedies() == std::vector<Remedy>{{RemedyKind::make_store}};
        }
        return false;
    };
    CHECK(refused([](auto& q) { q.stop = ErrorBound{0.1}; }));
    CHECK(refused([](auto& q) { q.stop = FieldThreshold{}; }));
    CHECK(refused([](auto& q) { q.stop = ErrorBound{0.1}; }));
    CHECK(refused([](auto& q) { q.stop = TriangleBudgetByError{100}; }));
    CHECK(refused([](auto& q) {
        q.stop = DistanceBound{1};
        q.effort = Effort::none;
    }));
    CHECK(refused([](auto& q) { q.focus.emplace(); }));
    CHECK(refused([](auto& q) { q.camera.emplace(); }));
    CHECK_FALSE(refused([](auto& q) { q.box = WorldBox{{0, 0, 0}, {1, 1, 1}}; }));
    CHECK_FALSE(refused([](auto& q) { q.grid.cells = Cells::tetrahedra; }));
    CHECK(refused([](auto& q) { q.grid.bound = Field::deviation_bar; }));
    CHECK(refused([](auto& q) { q.grid.culling.emplace(); }));
    CHECK(refused([](auto& q) { q.grid.vertices = VertexPlace::exact; }));
    CHECK_FALSE(refused([](auto& q) { q.stages.close = Outside::below; }));
    CHECK(refused([](auto& q) { q.attributes.error = Field::deviation_bar; }));
    CHECK(refused([](auto& q) {
        q.stop = DistanceBound{1};
        q.analysis.emplace();
    }));
    CHECK_FALSE(refused([](auto& q) { q.grid.cells = Cells::hexahedra; }));
    CHECK_FALSE(refused([](auto& q) { q.stop = DistanceBound{1}; }));
    for (const SurfaceStop& stop :
         {SurfaceStop(DistanceBound{-1}), SurfaceStop(TriangleBudgetByDistance{0})}) {
        SurfaceQuery query = at(0.25);
        query.stop = stop;
        MeshCollector mesh;
        CHECK_THROWS_AS(extract_volume(volume, query, mesh), Error);
    }
    FunctionVolume<float> flat({9, 1, 9}, ball);
    MeshCollector mesh;
    CHECK_THROWS_WITH(extract_volume(flat, at(0.25), mesh), Catch::Contains("need a store"));
    CHECK_FALSE(march_memory(flat, at(0.25)));
}

TEST_CASE("A store with the fields that a query needs answers it, and lacks none that it names") {
    FunctionVolume<float> volume({17, 17, 17}, ball);
    const TemporaryFolder folder;
    const auto answers = [&](const SurfaceQuery& query) {
        PreprocessOptions options;
        options.fields = fields_needed(query);
        options.force = true;
        preprocess(volume, folder / "s", options, silent_progress());
        MeshCollector mesh;
        extract(Store(folder / "s"), query, mesh);
        return !mesh.triangles.empty();
    };
    std::vector<SurfaceQuery> queries;
    for (const ErrorIndicator indicator :
         {ErrorIndicator::deviation, ErrorIndicator::plus, ErrorIndicator::estimate}) {
        for (const Cells cells : {Cells::tetrahedra, Cells::hexahedra}) {
            for (const SurfaceStop& stop : {SurfaceStop(ErrorBound{0.01, true, indicator}),
                                            SurfaceStop(TriangleBudgetByError{100, indicator})}) {
                SurfaceQuery& query = queries.emplace_back(at(0.25));
                query.stop = stop;
                query.effort = Effort::none;
                query.grid.cells = cells;
            }
        }
    }
    for (const Field field : all_fields()) {
        SurfaceQuery& query = queries.emplace_back(at(0.25));
        query.stop = FieldThreshold{field, 1e-3};
        query.grid.cells = is_of_cells(field) ? Cells::hexahedra : Cells::tetrahedra;
        if (is_bound(field)) {
            queries.emplace_back(at(0.25)).grid.bound = field;
        }
        if (!is_of_cells(field)) {
            queries.emplace_back(at(0.25)).attributes.error = field;
        }
    }
    for (const std::optional<Field> field :
         {std::optional<Field>(), std::optional(Field::normal_turn_plus),
          std::optional(Field::grad_linf_plus)}) {
        queries.emplace_back(at(0.25)).grid.culling = BackfaceCulling{{1, 0, 0}, field};
    }
    for (std::size_t i = 0; i < queries.size(); ++i) {
        CAPTURE(i);
        CHECK(answers(queries[i]));
    }
    // As every store, if nothing is named.
    CHECK(fields_needed(at(0.25)) == default_indicators());
    SurfaceQuery query = at(0.25);
    query.stop = DistanceBound{1};
    CHECK(fields_needed(query) == default_indicators());
}

TEST_CASE(
    "Stages on the full resolution give the same mesh as with a store, for any threads and "
    "memory") {
    const auto with_a_hole = [](const Int3& p) {
        return p.x > 40 && p.y > 40 && p.z > 30 ? std::numeric_limits<float>::quiet_NaN() : ball(p);
    };
    struct Asked {
        const char* what;
        std::function<void(SurfaceQuery&)> ask;
    };
    const std::vector<Asked> all{
        {"tetrahedra", [](auto& q) { q.grid.cells = Cells::tetrahedra; }},
        {"closed", [](auto& q) { q.stages.close = Outside::below; }},
        {"closed from above, with normals",
         [](auto& q) {
             q.stages.close = Outside::above;
             q.attributes.normals = true;
         }},
        {"a box",
         [](auto& q) {
             q.box = WorldBox{{1.25, 2, 3}, {30.5, 20, 44}};
         }},
        {"a closed box of tetrahedra",
         [](auto& q) {
             q.grid.cells = Cells::tetrahedra;
             q.stages.close = Outside::below;
             q.box = WorldBox{{1.25, 2, 3}, {30.5, 20, 44}};
         }},
        {"the largest component", [](auto& q) { q.stages.components.emplace().largest = 1; }},
        {"a distance", [](auto& q) { q.stop = DistanceBound{0.4}; }}};
    for (const Int3 nodes : {Int3{44, 45, 46}, Int3{66, 9, 34}, Int3{2, 3, 33}, Int3{33, 34, 65}}) {
        FunctionVolume<float> volume(nodes, with_a_hole);
        volume.granularity_ = {8, 4};
        const TemporaryFolder folder;
        preprocess(volume, folder / "s", with_chunk(16), silent_progress());
        const Store store(folder / "s");
        for (const Asked& asked : all) {
            SurfaceQuery query = at(0.25);
            query.grid.cells = Cells::hexahedra;
            asked.ask(query);
            MeshCollector stored;
            extract(store, query, stored);
            // Stages need additional memory.
            const std::uint64_t least =
                march_memory(volume, query).value() + (std::uint64_t{48} << 20U);
            for (const auto& [threads, memory] :
                 {std::pair{1, std::uint64_t{1} << 30U}, std::pair{3, least}}) {
                CAPTURE(asked.what, nodes.x, nodes.z, threads);
                MeshCollector mesh;
                extract_volume(volume, query, mesh, threads, memory);
                CHECK(same_mesh(mesh, stored));
            }
        }
    }
}

TEST_CASE("Marching works with the minimum memory of a volume, and is refused with less") {
    FunctionVolume<float> volume({44, 45, 46}, ball);
    volume.granularity_ = {8, 4};
    const std::uint64_t least = march_memory(volume, at(0.25)).value();
    MeshCollector mesh;
    CHECK(extract_volume(volume, at(0.25), mesh, 0, least).triangles > 0);
    CHECK_THROWS_AS(extract_volume(volume, at(0.25), mesh, 0, least - 1), Error);
}

TEST_CASE("A mesh file that is also one of the volume's files is refused and stays unchanged") {
    class OfFile : public FunctionVolume<float> {
      public:
        using FunctionVolume<float>::FunctionVolume;
        [[nodiscard]] std::vector<std::filesystem::path> files() const override { return {file}; }
        std::filesystem::path file;
    } volume({9, 9, 9}, ball);
    const TemporaryFolder folder;
    volume.file = folder / "v.ply";
    std::ofstream(volume.file) << "numbers";
    const auto sink = open_mesh_file(volume.file, {.replace = true});
    CHECK_THROWS_AS(extract(volume, at(0.25), *sink), Error);
    CHECK(std::filesystem::file_size(volume.file) == 7);
}
