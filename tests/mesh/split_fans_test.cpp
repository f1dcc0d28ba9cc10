// Each vertex of a surface has one fan of triangles, even where a face of the volume or of the box
// cuts the sheet through it into several fans. Compared with the walk around each vertex in
// check_mesh().
#include "query/apart/split_fans.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <set>
#include <string>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

using Point = std::array<float, 3>;

struct Split {
    std::uint64_t copies = 0;
    std::vector<Point> positions;
    std::vector<ElementCorners> corners;
};

/// In a box from 0 to 4.
Split split(const std::vector<Point>& positions, const std::vector<ElementCorners>& corners) {
    const TemporaryFolder folder;
    ScratchMesh scratch(folder.path());
    MeshLayout layout;
    layout.vertices = positions.size();
    layout.elements = corners.size();
    layout.row_bytes = sizeof(float);  // its x, to check that rows stay with their vertices
    layout.attributes = {{"value", 1, false, 0}};
    std::vector<float> rows;
    std::transform(positions.begin(), positions.end(), std::back_inserter(rows),
                   [](const Point& p) { return p[0]; });
    scratch.begin(layout);
    scratch.add_vertices({0, positions, std::as_bytes(std::span(rows)), sizeof(float)});
    scratch.add_elements({0, corners, {}, {}});
    scratch.end();
    Split s;
    s.copies = split_fans(scratch, {{0, 0, 0}, {4, 4, 4}}, folder.path(), silent_progress());
    CHECK(folder.names().empty());
    s.positions.assign(scratch.positions().begin(), scratch.positions().end());
    for (const ElementCorners t : scratch.corners()) {
        s.corners.push_back(t);
    }
    for (std::size_t v = 0; v < s.positions.size(); ++v) {
        float x = 0;
        std::memcpy(&x, scratch.row(v).data(), sizeof(x));
        CHECK(x == s.positions[v][0]);
    }
    return s;
}

/// A surface of an integer volume at one of its values; the query depends on `seed`.
struct Asked {
    explicit Asked(std::uint64_t seed)
        : random([seed, i = std::int64_t{0}]() mutable {
              return noise({++i, 0, 0}, seed);
          }),
          nodes{one_of(2, 6), one_of(2, 6), one_of(2, 6)},
          values(static_cast<int>(one_of(2, 4))),
          volume(nodes, [this, seed](const Int3& p) {
              return static_cast<float>(std::floor(noise(p, seed + 1000) * values));
          }) {
        surface.iso = static_cast<double>(one_of(1, values - 1));
        surface.error = random() * values;
        if (random() < 0.3) {
            surface.box = WorldBox{{0.5, 0, 0.25}, {2.5, 3, 3}};
        }
        if (random() < 0.3) {
            surface.vertices = VertexPlace::exact;
        } else if (random() < 0.3) {
            surface.cells = Cells::hexahedra;
        }
    }
    std::int64_t one_of(std::int64_t first, std::int64_t last) const {
        return first + static_cast<std::int64_t>(random() * static_cast<double>(last - first + 1));
    }

    std::function<double()> random;
    Int3 nodes;
    int values;
    FunctionVolume<float> volume;
    Extraction surface;
};

Mesh extracted(const StoreReader& store, const Extraction& surface,
               const std::filesystem::path& path) {
    extract(store, path, surface, silent_progress());
    return read_mesh(path);
}

}  // namespace

TEST_CASE("fans that meet at a vertex in a face of the box get separate vertices") {
    // In the plane z = 0, vertex 0 has two fans, of two triangles and of one.
    const Split s = split({{1, 1, 0}, {2, 1, 0}, {2, 2, 0}, {1, 2, 1}, {0, 1, 1}, {1, 0, 1}},
                          {{0, 1, 2}, {4, 5, 0}, {0, 2, 3}});
    CHECK(s.copies == 1);
    REQUIRE(s.positions.size() == 7);
    CHECK(s.positions[6] == s.positions[0]);
    CHECK(s.corners == std::vector<ElementCorners>{{0, 1, 2}, {4, 5, 6}, {0, 2, 3}});
}

TEST_CASE("fans that meet inside the box, and single fans in its faces, are not changed") {
    const std::vector<ElementCorners> corners{{0, 1, 2}, {4, 5, 0}, {0, 2, 3}};
    const Split inside =
        split({{1, 1, 1}, {2, 1, 0}, {2, 2, 0}, {1, 2, 1}, {0, 1, 1}, {1, 0, 1}}, corners);
    CHECK(inside.copies == 0);
    CHECK(inside.corners == corners);
    // A closed fan, and one from border to border.
    const std::vector<ElementCorners> single{{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {1, 4, 2}};
    const Split faces = split({{4, 1, 1}, {3, 0, 0}, {3, 2, 0}, {3, 1, 2}, {4, 1, 0}}, single);
    CHECK(faces.copies == 0);
    CHECK(faces.corners == single);
}

TEST_CASE("a sheet that leaves the volume at a vertex and re-enters has a vertex on each side") {
    // The middle of the coarsest cube's diagonal lies on two edges of the volume, whose sizes are
    // not 2^k + 1, and three triangles of the surface meet there.
    constexpr std::array<float, 12> kValues{0, 1, 2, 2, 0, 1, 1, 2, 2, 2, 1, 2};
    const Int3 nodes{2, 2, 3};
    FunctionVolume<float> volume(nodes, [&](const Int3& p) {
        return kValues.at(static_cast<std::size_t>(nodes.linear(p)));
    });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const StoreReader store(folder / "s");
    Extraction surface;
    surface.iso = 1;
    surface.error = 2;
    const Mesh mesh = extracted(store, surface, folder / "m.ply");
    CHECK(mesh.triangles.size() == 3);
    CHECK(mesh.vertices.size() == 7);
    CHECK(check_mesh(mesh, {0, 0, 0}, {1, 1, 2}).split_vertices == 0);
    CHECK(std::set(mesh.vertices.begin(), mesh.vertices.end()).size() == 7);
}

TEST_CASE(
    "coarse surfaces through nodes, clipped by faces, have one fan at each vertex, for any threads "
    "and memory") {
    std::size_t triangles = 0;
    for (std::uint64_t seed = 1; seed <= 250; ++seed) {
        Asked asked(seed);
        CAPTURE(seed, asked.nodes.x, asked.nodes.y, asked.nodes.z, asked.surface.iso,
                *asked.surface.error);
        const TemporaryFolder folder;
        PreprocessOptions options = with_chunk(8);
        options.fields = {Field::deviation_bar, Field::hex_deviation};
        make_store(asked.volume, folder / "s", options);
        const StoreReader store(folder / "s");
        const Mesh mesh = extracted(store, asked.surface, folder / "m.ply");
        triangles += mesh.triangles.size();
        const MeshFaults faults = check_mesh(mesh, {0, 0, 0}, {6, 6, 6});
        CHECK(faults.split_vertices == 0);
        CHECK(faults.unused_vertices == 0);
        CHECK(faults.overused_edges == 0);
        CHECK(faults.misoriented_edges == 0);
        CHECK(std::set(mesh.vertices.begin(), mesh.vertices.end()).size() == mesh.vertices.size());
        const std::string bytes = read_file(folder / "m.ply");
        for (const int threads : {1, 3}) {
            Extraction other = asked.surface;
            other.threads = threads;
            other.memory = std::uint64_t{24} << 20U;
            extract(store, folder / "n.ply", other, silent_progress());
            CHECK(read_file(folder / "n.ply") == bytes);
        }
    }
    CHECK(triangles > 1000);
}
