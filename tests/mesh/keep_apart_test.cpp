// Vertices with the same position are moved apart: each toward its own sheet, not farther than
// promised, and no triangle loses its area.
#include "query/apart/keep_apart.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>
#include <set>

#include <isonest/march.h>
#include <isonest/memory_volume.h>

#include "query/mesh/mend_triangles.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

using Place = std::array<float, 3>;

struct Sheets {
    std::vector<Place> positions;
    std::vector<ElementCorners> triangles;

    /// A pyramid without a base around its apex; its triangles face away from the axis if
    /// `outward`. Returns the apex' number.
    std::uint64_t add_pyramid(const Place& apex, float height, bool outward, int corners = 4) {
        const std::uint64_t first = positions.size();
        positions.push_back(apex);
        for (int i = 0; i < corners; ++i) {
            const double angle = 2 * 3.14159265358979 * i / corners;
            positions.push_back({apex[0] + static_cast<float>(std::cos(angle)),
                                 apex[1] + static_cast<float>(std::sin(angle)), apex[2] + height});
        }
        for (int i = 0; i < corners; ++i) {
            const std::uint64_t a = first + 1 + static_cast<std::uint64_t>(i);
            const std::uint64_t b = first + 1 + static_cast<std::uint64_t>((i + 1) % corners);
            const bool turned = outward == (height > 0);
            triangles.push_back(turned ? ElementCorners{first, b, a} : ElementCorners{first, a, b});
        }
        return first;
    }

    ApartVertices keep_apart(ApartRange range) {
        const TemporaryFolder folder;
        std::vector<PlacedVertex> vertices;
        for (std::uint64_t v = 0; v < positions.size(); ++v) {
            vertices.push_back(placed_vertex(v, positions[v]));
        }
        if (sort_by_place(vertices) == 0) {
            return {};
        }
        TouchedTriangles touched(vertices, positions.size(), folder.path());
        touched.gather_among(
            triangles.size(), [&](std::uint64_t t) { return triangles[t]; }, silent_progress());
        return detail::keep_apart(positions, touched.all(), vertices, range, folder.path(),
                                  silent_progress());
    }
    [[nodiscard]] std::size_t places() const {
        return std::set<Place>(positions.begin(), positions.end()).size();
    }
};

constexpr float kNowhere = std::numeric_limits<float>::quiet_NaN();

ApartRange without_box() {
    constexpr float kFar = 1e30F;
    return {true,
            {kMinApart, kMinApart, kMinApart},
            {},
            {-kFar, -kFar, -kFar},
            {kFar, kFar, kFar},
            {kNowhere, kNowhere, kNowhere},
            {kNowhere, kNowhere, kNowhere}};
}

}  // namespace

TEST_CASE("Sheets that touch in a node are moved apart, each to its own side") {
    Sheets sheets;
    const Place at{3, 4, 5};
    const std::uint64_t up = sheets.add_pyramid(at, 1, false);
    const std::uint64_t down = sheets.add_pyramid(at, -1, false);
    const std::vector<Place> before = sheets.positions;
    const ApartVertices apart = sheets.keep_apart(without_box());
    CHECK(apart.moved == 2);
    CHECK(apart.left == 0);
    CHECK(sheets.positions[up][2] == 5 + static_cast<float>(kMinApart));
    CHECK(sheets.positions[down][2] == 5 - static_cast<float>(kMinApart));
    CHECK(apart.by[2] == kMinApart);
    for (std::size_t v = 0; v < before.size(); ++v) {
        CHECK((sheets.positions[v] == before[v]) == (v != up && v != down));
    }
}

TEST_CASE("Sheets with the same normal are moved by different distances along it") {
    Sheets sheets;
    for (int i = 0; i < 3; ++i) {
        sheets.add_pyramid({1, 1, 1}, 1, true);
        for (std::size_t k = 1; k <= 4; ++k) {  // other vertices have positions of their own
            sheets.positions[sheets.positions.size() - k][2] += static_cast<float>(i);
        }
    }
    const ApartVertices apart = sheets.keep_apart(without_box());
    CHECK(apart.left == 0);
    CHECK(sheets.places() == sheets.positions.size());
    CHECK(apart.by[2] <= kMaxApart * kMinApart);
}

TEST_CASE("Forty vertices at one position are all moved apart, even far from the origin") {
    for (const float origin : {0.0F, 1000.0F, 1e6F}) {
        Sheets sheets;
        std::mt19937 random(7);
        std::uniform_real_distribution<float> height(0.5F, 2.0F);
        for (int i = 0; i < 40; ++i) {
            sheets.add_pyramid({origin, -origin, 3 * origin}, i % 2 == 0 ? height(random) : -1,
                               i % 3 == 0, 3 + i % 4);
        }
        const std::vector<Place> before = sheets.positions;
        const ApartVertices apart = sheets.keep_apart(without_box());
        CAPTURE(origin);
        CHECK(apart.moved >= 39);
        CHECK(apart.left == 0);
        std::set<Place> places;
        for (std::size_t v = 0; v < before.size(); ++v) {
            if (sheets.positions[v] != before[v]) {
                places.insert(sheets.positions[v]);
            }
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const double unit =
                    std::nextafter(std::fabs(before[v][axis]), 1e30F) - std::fabs(before[v][axis]);
                CHECK(std::fabs(sheets.positions[v][axis] - before[v][axis]) <=
                      kMaxApart * std::max(unit, kMinApart) * 1.001);
            }
        }
        CHECK(places.size() == apart.moved);
        for (const ElementCorners& t : sheets.triangles) {
            CHECK(missing_dimensions(sheets.positions[t[0]], sheets.positions[t[1]],
                                     sheets.positions[t[2]]) == 0);
        }
    }
}

TEST_CASE("A vertex in a face of the box stays in it, and the mesh keeps its box") {
    Sheets sheets;
    const Place at{0, 2, 2};
    const std::uint64_t up = sheets.add_pyramid(at, 1, false);
    const std::uint64_t down = sheets.add_pyramid(at, -1, false);
    ApartRange range = without_box();
    range.low_faces = {0, kNowhere, kNowhere};
    range.hi[2] = 2;  // as if the sheet were entirely below
    const ApartVertices apart = sheets.keep_apart(range);
    CHECK(apart.left == 0);
    CHECK(sheets.positions[up] == at);
    CHECK(sheets.positions[down][0] == 0);
    CHECK(sheets.positions[down][2] < 2);
}

TEST_CASE("In a corner of the box one of two vertices leaves the faces") {
    Sheets sheets;
    sheets.add_pyramid({1, 1, 1}, 1, false);
    sheets.add_pyramid({1, 1, 1}, -1, false);
    ApartRange range = without_box();
    range.low_faces = {1, 1, 1};
    const ApartVertices apart = sheets.keep_apart(range);
    CHECK(apart.left == 0);
    CHECK(apart.moved == 1);
}

TEST_CASE("If steps of float32 are too long, vertices are counted but not moved") {
    Sheets sheets;
    sheets.add_pyramid({1, 1, 1}, 1, false);
    sheets.add_pyramid({1, 1, 1}, -1, false);
    ApartRange range = without_box();
    range.moves = false;
    const std::vector<Place> before = sheets.positions;
    const ApartVertices apart = sheets.keep_apart(range);
    CHECK(apart.left == 2);
    CHECK(apart.moved == 0);
    CHECK(sheets.positions == before);
}

TEST_CASE("Vertices with a position of their own are not moved") {
    Sheets sheets;
    sheets.add_pyramid({1, 1, 1}, 1, false);
    const std::vector<Place> before = sheets.positions;
    CHECK(sheets.keep_apart(without_box()).moved == 0);
    CHECK(sheets.positions == before);
}

TEST_CASE("No two vertices of a marched volume have the same position") {
    for (const unsigned levels : {2U, 3U, 5U}) {
        for (const double origin : {0.0, 1e5}) {
            std::mt19937 random(levels);
            const Int3 nodes{20, 17, 23};
            std::vector<std::uint8_t> values(static_cast<std::size_t>(nodes.product()));
            for (std::uint8_t& value : values) {
                value = static_cast<std::uint8_t>(random() % levels);
            }
            MemoryLayout layout;
            layout.origin = {origin, -origin, 0};
            MemoryVolume volume(values.data(), nodes, layout);
            MeshCollector one;
            MeshCollector two;
            ExtractOptions options;
            options.threads = 1;
            const ExtractReport report = march_hexahedra(volume, {1, true}, one, options);
            options.threads = 7;
            march_hexahedra(volume, {1, true}, two, options);
            CAPTURE(levels, origin, report.apart.moved);
            CHECK(report.apart.together == 0);
            CHECK(report.apart.moved > 100);
            CHECK(std::set<Place>(one.vertices.begin(), one.vertices.end()).size() ==
                  one.vertices.size());
            CHECK((one.vertices == two.vertices && one.triangles == two.triangles));
        }
    }
}
