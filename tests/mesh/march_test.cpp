// The fast paths of marching tetrahedra give the same result as the slow one.
#include <catch2/catch.hpp>
#include <map>
#include <random>

#include "query/march/local_mesh.h"
#include "store/base/box.h"
#include "store/lattice/simplex.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr double kIso = 1;

/// Marches the six tetrahedra of a cube of edge 1 one by one; returns the number with nodes on both
/// sides.
template <class Value>
unsigned march_tetrahedra(LocalMesh& mesh, const Int3& cube, const Value& value) {
    unsigned crossed = 0;
    for (int order = 0; order < 6; ++order) {
        const Tetrahedron t = kuhn_tetrahedron(cube, 1, order);
        std::array<Corner, 4> corners{};
        unsigned below = 0;
        for (std::size_t i = 0; i < 4; ++i) {
            corners[i] = {t.v[i], value(t.v[i])};
            below += corners[i].value < kIso ? 1 : 0;
        }
        const Int3 a = t.v[1] - t.v[0];
        const Int3 b = t.v[2] - t.v[0];
        const Int3 c = t.v[3] - t.v[0];
        const std::int64_t det = a.x * (b.y * c.z - b.z * c.y) - a.y * (b.x * c.z - b.z * c.x) +
                                 a.z * (b.x * c.y - b.y * c.x);
        mesh.march(corners, det > 0, kIso, false);
        crossed += below > 0 && below < 4 ? 1 : 0;
    }
    return crossed;
}

using NameKey = std::tuple<std::uint64_t, std::uint64_t, int>;

/// The vertex, or none, that each name shared with other parts stands for.
std::map<NameKey, std::uint32_t> names_of(const MeshPart& part) {
    std::map<NameKey, std::uint32_t> names;
    for (const MeshPart::Name& n : part.names) {
        const bool fresh =
            names
                .emplace(NameKey{n.key.first, n.key.second, static_cast<int>(n.key.kind)},
                         part.shared.at(n.shared).vertex)
                .second;
        CHECK(fresh);
    }
    return names;
}

void require_equal(const MeshPart& a, const MeshPart& b) {
    REQUIRE(a.positions == b.positions);
    REQUIRE(a.triangles == b.triangles);
    REQUIRE(names_of(a) == names_of(b));
}

}  // namespace

TEST_CASE(
    "a cube's case gives the triangles of its six tetrahedra, for all sides and mirror images") {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> away(0.1, 1);
    LocalMesh by_case(nullptr);
    LocalMesh by_tetrahedra(nullptr);
    std::size_t triangles = 0;
    for (unsigned mirror = 0; mirror < 8; ++mirror) {
        for (unsigned below = 0; below < 256; ++below) {
            Cube cube{{4 + (mirror & 1U), 2 + (mirror >> 1U & 1U), 6 + (mirror >> 2U)},
                      mirror,
                      below,
                      {}};
            for (std::size_t i = 0; i < 8; ++i) {
                cube.value[i] = (below >> i & 1U) != 0 ? kIso - away(random) : kIso + away(random);
            }
            by_case.place({4, 2, 6}, 0, {2, 2, 2});
            const unsigned leaves = by_case.march_cube(cube, kIso, false);
            const unsigned crossed =
                march_tetrahedra(by_tetrahedra, cube.low, [&](const Int3& node) {
                    const Int3 d = node - cube.low;
                    return cube.value[static_cast<unsigned>(d.x + 2 * d.y + 4 * d.z) ^ mirror];
                });
            REQUIRE(leaves == crossed);
            const MeshPart part = by_case.finish({});
            require_equal(part, by_tetrahedra.finish({}));
            triangles += part.triangles.size();

            unsigned one_by_one = 0;
            for (std::size_t order = 0; order < 6; ++order) {
                one_by_one += by_case.march_in_cube(cube, order, kIso, false);
            }
            REQUIRE(one_by_one == crossed);
            require_equal(part, by_case.finish({}));
        }
    }
    REQUIRE(triangles > 8 * 256 * 2);
}

TEST_CASE("vertices are the same by table and by hashing") {
    std::mt19937 random(2);
    LocalMesh by_table(nullptr);
    LocalMesh by_hashing(nullptr);
    constexpr Int3 kCells{4, 3, 5};
    constexpr Int3 kLow{8, 2, 6};
    std::size_t incomplete = 0;
    for (int round = 0; round < 200; ++round) {
        Box<double> box(kLow, kCells + Int3{1, 1, 1});
        for (double& value : box.data) {
            value = static_cast<double>(random() % 3);  // a third of the nodes are at the isovalue
        }
        by_table.place(kLow, 0, kCells);
        for (std::int64_t i = 0; i < kCells.product(); ++i) {
            const Int3 cube = kLow + kCells.unlinear(i);
            const auto value = [&](const Int3& node) { return box.at(node); };
            march_tetrahedra(by_table, cube, value);
            march_tetrahedra(by_hashing, cube, value);
        }
        const MeshPart part = by_table.finish({});
        require_equal(part, by_hashing.finish({}));
        incomplete += part.names.size();
    }
    REQUIRE(incomplete > 1000);
}
