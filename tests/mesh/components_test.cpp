// Components: those that are kept, compared with a search of the whole mesh in memory.
#include <algorithm>
#include <catch2/catch.hpp>
#include <deque>
#include <set>

#include <isonest/error.h>
#include <isonest/extract.h>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

using Point = std::array<float, 3>;
using Corners = std::vector<Point>;

/// The triangles or lines of the mesh, by the positions of their corners.
std::vector<Corners> elements_of(const MeshCollector& mesh) {
    std::vector<Corners> elements;
    for (const auto& t : mesh.triangles) {
        elements.push_back({mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]});
    }
    for (const auto& s : mesh.lines) {
        elements.push_back({mesh.vertices[s[0]], mesh.vertices[s[1]]});
    }
    return elements;
}

std::vector<std::vector<std::uint32_t>> numbers_of(const MeshCollector& mesh) {
    std::vector<std::vector<std::uint32_t>> elements;
    for (const auto& t : mesh.triangles) {
        elements.emplace_back(t.begin(), t.end());
    }
    for (const auto& s : mesh.lines) {
        elements.emplace_back(s.begin(), s.end());
    }
    return elements;
}

struct Found {
    std::vector<std::size_t> elements;  ///< ascending
    bool closed = true;
    double volume = 0;
};

/// Breadth-first search, starting at the lowest vertex that has not been visited.
std::vector<Found> components_of(const MeshCollector& mesh) {
    const auto elements = numbers_of(mesh);
    std::vector<std::vector<std::size_t>> around(mesh.vertices.size());
    for (std::size_t e = 0; e < elements.size(); ++e) {
        for (const std::uint32_t v : elements[e]) {
            around[v].push_back(e);
        }
    }
    std::vector<bool> met(mesh.vertices.size());
    std::vector<Found> found;
    for (std::uint32_t start = 0; start < met.size(); ++start) {
        if (met[start]) {
            continue;
        }
        std::set<std::size_t> own;
        std::deque<std::uint32_t> next{start};
        met[start] = true;
        while (!next.empty()) {
            for (const std::size_t e : around[next.front()]) {
                own.insert(e);
                for (const std::uint32_t v : elements[e]) {
                    if (!met[v]) {
                        met[v] = true;
                        next.push_back(v);
                    }
                }
            }
            next.pop_front();
        }
        Found c;
        c.elements.assign(own.begin(), own.end());
        std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
        for (const std::size_t e : c.elements) {
            const auto& t = elements[e];
            if (t.size() < 3) {
                continue;
            }
            for (std::size_t i = 0; i < 3; ++i) {
                ++edges[{t[i], t[(i + 1) % 3]}];
                --edges[{t[(i + 1) % 3], t[i]}];
            }
            const auto& a = mesh.vertices[t[0]];
            const auto& b = mesh.vertices[t[1]];
            const auto& p = mesh.vertices[t[2]];
            for (std::size_t i = 0; i < 3; ++i) {
                const std::size_t j = (i + 1) % 3;
                const std::size_t k = (i + 2) % 3;
                c.volume += static_cast<double>(a[i]) *
                            (static_cast<double>(b[j]) * p[k] - static_cast<double>(b[k]) * p[j]) /
                            6;
            }
        }
        c.closed = std::all_of(edges.begin(), edges.end(), [](auto& e) { return e.second == 0; });
        found.push_back(c);
    }
    return found;
}

std::vector<bool> kept_of(const std::vector<Found>& found, const ComponentChoice& choice) {
    std::vector<bool> kept(found.size());
    std::vector<std::size_t> order;
    for (std::size_t i = 0; i < found.size(); ++i) {
        kept[i] = found[i].elements.size() >= choice.min_triangles &&
                  (!found[i].closed || choice.min_volume <= std::fabs(found[i].volume));
        if (kept[i]) {
            order.push_back(i);
        }
    }
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        return found[a].elements.size() > found[b].elements.size();
    });
    for (std::size_t i = choice.largest; choice.largest > 0 && i < order.size(); ++i) {
        kept[order[i]] = false;
    }
    return kept;
}

/// A store, and surfaces of it.
class Volume {
  public:
    template <class T>
    explicit Volume(FunctionVolume<T>& volume, int chunk = 8) {
        make_store(volume, folder_ / "s", with_chunk(chunk));
        store_.emplace(folder_ / "s");
    }
    ExtractReport extract(const SurfaceQuery& query, MeshCollector& mesh, int threads = 2,
                          std::uint64_t memory = 1U << 30U) const {
        ExtractOptions options;
        options.threads = threads;
        options.memory = memory;
        options.scratch = folder_.path();
        const ExtractReport r = isonest::extract(*store_, query, mesh, options);
        CHECK(folder_.names().size() == 1);  // no other file is left
        return r;
    }

  private:
    TemporaryFolder folder_;
    std::optional<Store> store_;
};

/// The elements kept are those that the search selects, in the same order.
ExtractReport require_as_searched(const Volume& volume, SurfaceQuery query,
                                  const ComponentChoice& choice) {
    MeshCollector whole;
    const ExtractReport without = volume.extract(query, whole);
    CHECK_FALSE(without.components);
    const auto all = elements_of(whole);
    const auto found = components_of(whole);
    const auto kept = kept_of(found, choice);
    std::set<std::size_t> left;
    std::uint64_t dropped = 0;
    std::uint64_t largest = 0;
    for (std::size_t i = 0; i < found.size(); ++i) {
        if (kept[i]) {
            left.insert(found[i].elements.begin(), found[i].elements.end());
        } else {
            ++dropped;
            largest = std::max<std::uint64_t>(largest, found[i].elements.size());
        }
    }
    std::vector<Corners> expected;
    for (const std::size_t e : left) {
        expected.push_back(all[e]);
    }
    query.stages.components = choice;
    MeshCollector mesh;
    const ExtractReport r = volume.extract(query, mesh);
    REQUIRE(r.components);
    CHECK(r.components->components == found.size());
    CHECK(r.components->dropped == dropped);
    CHECK(r.components->dropped_triangles == all.size() - expected.size());
    CHECK(r.components->largest_dropped == largest);
    CHECK(r.triangles == expected.size());
    CHECK(r.vertices == mesh.vertices.size());
    CHECK(elements_of(mesh) == expected);
    return r;
}

struct Ball {
    Double3 centre;
    double radius;
};

/// Positive inside a ball, and between the two surfaces of a hollow one.
float balls_at(const std::vector<Ball>& balls, const Int3& p) {
    double most = -3;
    for (const Ball& b : balls) {
        const double away = std::hypot(static_cast<double>(p.x) - b.centre[0],
                                       static_cast<double>(p.y) - b.centre[1],
                                       static_cast<double>(p.z) - b.centre[2]);
        most = std::max(most, std::min(b.radius - away, away - (b.radius - 4)));
    }
    return static_cast<float>(most);
}

/// Shells and solid balls, two of them equal, and one clipped by the volume's border.
FunctionVolume<float> some_balls() {
    const std::vector<Ball> balls{{{12, 12, 12}, 9.3}, {{32.2, 12, 12}, 6.4}, {{32, 32, 32}, 2.6},
                                  {{16, 32, 32}, 2.6}, {{32, 16, 32}, 3.7},   {{16, 16, 34}, 2.4},
                                  {{44, 44, 44}, 7.2}, {{0, 40, 10}, 3.4}};
    return {{45, 45, 45}, [balls](const Int3& p) { return balls_at(balls, p); }};
}

float grains(const Int3& p) {
    return static_cast<float>(noise({p.x / 2, p.y / 2, p.z / 2}) + noise(p));
}

}  // namespace

TEST_CASE("balls are kept or dropped as a search of the mesh says") {
    FunctionVolume<float> balls = some_balls();
    balls.spacing_ = {0.5, 1, 2};
    const Volume volume(balls);
    for (const double error : {0.0, 0.3}) {
        SurfaceQuery query;
        query.stop = ErrorBound{error};
        query.effort = Effort::none;
        require_as_searched(volume, query, {});
        for (const std::uint64_t largest : {1, 2, 3, 6, 7, 8, 50}) {
            require_as_searched(volume, query, {largest});
        }
        for (const std::uint64_t least : {1, 60, 200, 100000}) {
            require_as_searched(volume, query, {0, least});
        }
        for (const double least : {1e-9, 30.0, 100.0, 1000.0, 1e9}) {
            require_as_searched(volume, query, {0, 0, least});
        }
        require_as_searched(volume, query, {2, 60, 100});
    }
    // Open components are kept for any minimum volume.
    MeshCollector mesh;
    SurfaceQuery query;
    query.stages.components = ComponentChoice{0, 0, 1e9};
    volume.extract(query, mesh);
    const auto found = components_of(mesh);
    CHECK(found.size() == 3);  // two of the shell in the corner, one at the face
    CHECK(std::none_of(found.begin(), found.end(), [](const Found& c) { return c.closed; }));
}

TEST_CASE("of equally large components the one with the lowest vertex is kept") {
    FunctionVolume<float> volume({65, 33, 33}, [](const Int3& p) {
        const auto off = [](std::int64_t v) { return static_cast<double>(v % 16 - 8); };
        return static_cast<float>(3.3 - std::hypot(off(p.x), off(p.y), off(p.z)));
    });
    const Volume balls(volume);
    for (const std::uint64_t largest : {1, 2, 5, 15, 16}) {
        const ExtractReport r = require_as_searched(balls, {}, {largest});
        CHECK(r.components->components == 16);
        CHECK(r.components->dropped == 16 - largest);
    }
}

TEST_CASE("components of noise, with holes and clipped by a box") {
    FunctionVolume<float> volume({25, 24, 23}, [](const Int3& p) {
        return noise(p, 3) < 0.05 ? std::numeric_limits<float>::quiet_NaN() : grains(p);
    });
    const Volume grain(volume);
    for (const double iso : {0.45, 1.0, 1.5}) {
        SurfaceQuery query;
        query.iso = iso;
        for (const ComponentChoice& choice :
             {ComponentChoice{}, {1, 0, 0}, {7, 0, 0}, {0, 9, 0}, {0, 0, 0.3}, {4, 9, 0.4}}) {
            query.box = {};
            CHECK(require_as_searched(grain, query, choice).components->components > 2);
            query.box = WorldBox{{3.5, 4, 5}, {20, 21.5, 22}};
            require_as_searched(grain, query, choice);
        }
    }
}

TEST_CASE("isolines have components as well, but no volume") {
    FunctionVolume<float> volume({60, 50, 1}, grains);
    const Volume map(volume);
    SurfaceQuery query;
    query.iso = 1.2;
    for (const ComponentChoice& choice : {ComponentChoice{}, {1, 0}, {9, 0}, {0, 12}, {3, 12}}) {
        CHECK(require_as_searched(map, query, choice).components->components > 20);
    }
    MeshCollector mesh;
    query.stages.components = ComponentChoice{0, 0, 1};
    CHECK_THROWS_WITH(map.extract(query, mesh), Catch::Contains("minimum volume"));
}

TEST_CASE("the kept components do not depend on threads, memory and chunks") {
    FunctionVolume<float> volume({22, 25, 18}, grains);
    SurfaceQuery query;
    query.iso = 0.5;
    query.stages.components = ComponentChoice{25, 9, 0.1};
    for (const double distance : {0.0, 0.3}) {
        query.stop = DistanceBound{distance};
        std::optional<MeshCollector> first;
        for (const int chunk : {8, 32}) {
            const Volume store(volume, chunk);
            for (const int threads : {1, 2, 5}) {
                for (const std::uint64_t memory : {96ULL << 20U, 1ULL << 30U}) {
                    MeshCollector mesh;
                    const ExtractReport r = store.extract(query, mesh, threads, memory);
                    CHECK(r.components->components - r.components->dropped == 25);
                    if (!first) {
                        first.emplace();
                        first->vertices = mesh.vertices;
                        first->triangles = mesh.triangles;
                    }
                    CHECK(first->vertices == mesh.vertices);
                    CHECK(first->triangles == mesh.triangles);
                }
            }
        }
    }
}

TEST_CASE("components are dropped before the mesh is simplified within a distance") {
    FunctionVolume<float> balls = some_balls();
    const Volume volume(balls);
    SurfaceQuery query;
    query.grid.cells = GENERATE(Cells::tetrahedra, Cells::hexahedra);
    MeshCollector whole;
    const std::uint64_t all = volume.extract(query, whole).triangles;
    query.stop = DistanceBound{0.4};
    query.stages.components = ComponentChoice{0, 200};
    MeshCollector mesh;
    const ExtractReport r = volume.extract(query, mesh);
    const auto found = components_of(whole);
    const auto kept = kept_of(found, *query.stages.components);
    // Simplified to fewer triangles than the minimum, but kept: the minimum refers to the extracted
    // triangles.
    CHECK(r.triangles < (all - r.components->dropped_triangles) / 3);
    CHECK(r.distance->full_triangles == all);
    CHECK(r.distance->bound > 0);
    CHECK(r.distance->bound <= 0.4);
    CHECK(r.components->dropped > 0);
    CHECK(components_of(mesh).size() ==
          static_cast<std::size_t>(std::count(kept.begin(), kept.end(), true)));
    query.stages.components = ComponentChoice{0, 1000000};
    const ExtractReport none = volume.extract(query, mesh);
    CHECK(none.triangles == 0);
    CHECK(none.vertices == 0);
    CHECK(mesh.vertices.empty());
    CHECK(none.components->dropped == none.components->components);
    CHECK(none.components->dropped_triangles == all);
}

TEST_CASE("an empty surface has no components") {
    FunctionVolume<float> balls = some_balls();
    const Volume volume(balls);
    for (const double distance : {0.0, 0.5}) {
        SurfaceQuery query;
        query.iso = 99;
        query.stop = DistanceBound{distance};
        query.stages.components = ComponentChoice{1, 5, 2};
        MeshCollector mesh;
        const ExtractReport r = volume.extract(query, mesh);
        CHECK(r.components->components == 0);
        CHECK(r.components->dropped == 0);
        CHECK(r.triangles == 0);
    }
}

TEST_CASE("an invalid volume is refused") {
    FunctionVolume<float> balls = some_balls();
    const Volume volume(balls);
    for (const double least : {-1.0, std::numeric_limits<double>::quiet_NaN(),
                               std::numeric_limits<double>::infinity()}) {
        SurfaceQuery query;
        query.stages.components = ComponentChoice{0, 0, least};
        MeshCollector mesh;
        CHECK_THROWS_AS(volume.extract(query, mesh), Error);
    }
}

TEST_CASE(
    "a number of triangles that is too small for the components is refused with the advice to keep "
    "fewer of them") {
    // Balls of two sizes; each keeps at least the four triangles of a tetrahedron.
    FunctionVolume<float> volume({49, 33, 33}, [](const Int3& p) {
        const bool is_large = p.x < 32;
        const Int3 q = is_large ? Int3{16, 16, 16} : Int3{40, p.y / 11 * 11 + 5, p.z / 11 * 11 + 5};
        return static_cast<float>(std::hypot(p.x - q.x, p.y - q.y, p.z - q.z) -
                                  (is_large ? 12.3 : 2.3));
    });
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(16));
    const Store store(folder / "s");
    SurfaceQuery query;
    query.iso = 0;
    query.stop = TriangleBudgetByDistance{30};
    MeshCollector mesh;
    try {
        extract(store, query, mesh);
        FAIL("ten components have more than 30 triangles");
    } catch (const Error& error) {
        CHECK(error.kind() == ErrorKind::limit);
        CHECK_THAT(error.problem(), Catch::Contains("the largest of its 10 components has"));
        CHECK(error.remedies() == std::vector<Remedy>{{RemedyKind::fewer_components}});
    }
    query.stages.components = ComponentChoice{1, 0, 0};
    CHECK(extract(store, query, mesh).triangles <= 30);
    // One component has no others to drop.
    query.stop = TriangleBudgetByDistance{3};
    try {
        extract(store, query, mesh);
        FAIL("a closed surface has four triangles at least");
    } catch (const Error& error) {
        CHECK(error.remedies().empty());
    }
}
