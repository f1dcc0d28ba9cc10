// Isolines within a distance: measured by sampling in both directions, and with the same topology.
#include "query/simplify/simplify_lines.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <set>

#include <isonest/extract.h>

#include "store/base/workers.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

using Point = std::array<float, 3>;

struct Drawing {
    std::vector<Point> points;
    std::vector<std::array<std::uint32_t, 2>> lines;

    /// Appends a chain, or a loop if its last point is to be connected with the first.
    void add(const std::vector<Point>& chain, bool loop) {
        const auto first = static_cast<std::uint32_t>(points.size());
        const auto n = static_cast<std::uint32_t>(chain.size());
        points.insert(points.end(), chain.begin(), chain.end());
        for (std::uint32_t i = 0; i + 1 < n; ++i) {
            lines.push_back({first + i, first + i + 1});
        }
        if (loop) {
            lines.push_back({first + n - 1, first});
        }
    }
    /// Changes the order of the lines, and reverses some of them.
    void shuffle() {
        std::map<double, std::size_t> order;
        for (std::size_t i = 0; i < lines.size(); ++i) {
            order[noise({static_cast<std::int64_t>(i), 0, 0})] = i;
        }
        const auto before = std::exchange(lines, {});
        for (const auto& [key, i] : order) {
            const auto& line = before[i];
            lines.push_back(i % 3 == 0 ? std::array{line[1], line[0]} : line);
        }
    }
};

Drawing drawing_of(const MeshCollector& mesh) {
    return {mesh.vertices, mesh.lines};
}

double square_distance(const Double3& p, const Point& a, const Point& b) {
    double ab = 0;
    double ap = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        ab += (double{b[i]} - a[i]) * (double{b[i]} - a[i]);
        ap += (p[i] - a[i]) * (double{b[i]} - a[i]);
    }
    const double t = ab > 0 ? std::clamp(ap / ab, 0.0, 1.0) : 0;
    double sum = 0;
    for (std::size_t i = 0; i < 3; ++i) {
        const double d = p[i] - (a[i] + t * (double{b[i]} - a[i]));
        sum += d * d;
    }
    return sum;
}

/// The maximum distance of points on `a` from `b`, with `samples` on each line.
double one_sided(const Drawing& a, const Drawing& b, int samples) {
    double worst = 0;
    for (const auto& line : a.lines) {
        for (int s = 0; s <= samples; ++s) {
            Double3 p{};
            for (std::size_t i = 0; i < 3; ++i) {
                const double from = a.points[line[0]][i];
                p[i] = from + (a.points[line[1]][i] - from) * s / samples;
            }
            double best = std::numeric_limits<double>::max();
            for (const auto& other : b.lines) {
                best = std::min(best, square_distance(p, b.points[other[0]], b.points[other[1]]));
            }
            worst = std::max(worst, best);
        }
    }
    return std::sqrt(worst);
}

/// The properties that must be preserved.
struct Kept {
    std::multiset<std::pair<Point, Point>> chains;  ///< their ends, the smaller one first
    std::size_t loops = 0;
    std::size_t shortest_loop = std::numeric_limits<std::size_t>::max();  ///< lines
    std::size_t points_without_lines = 0;
};

Kept topology(const Drawing& d) {
    std::vector<std::vector<std::size_t>> at(d.points.size());
    for (std::size_t l = 0; l < d.lines.size(); ++l) {
        at[d.lines[l][0]].push_back(l);
        at[d.lines[l][1]].push_back(l);
    }
    std::vector<bool> taken(d.lines.size());
    Kept t;
    const auto follow = [&](std::size_t point, std::size_t line) {
        const std::size_t from = point;
        std::size_t length = 0;
        while (true) {
            taken[line] = true;
            ++length;
            point = d.lines[line][d.lines[line][0] == point ? 1 : 0];
            if (at[point].size() != 2) {
                t.chains.insert(std::minmax(d.points[from], d.points[point]));
                return;
            }
            line = at[point][at[point][0] == line ? 1 : 0];
            if (taken[line]) {
                ++t.loops;
                t.shortest_loop = std::min(t.shortest_loop, length);
                return;
            }
        }
    };
    for (std::size_t p = 0; p < at.size(); ++p) {
        t.points_without_lines += at[p].empty() ? 1 : 0;
        for (const std::size_t line : at[p]) {
            if (at[p].size() != 2 && !taken[line]) {
                follow(p, line);
            }
        }
    }
    for (std::size_t l = 0; l < d.lines.size(); ++l) {
        if (!taken[l]) {
            follow(d.lines[l][0], l);
        }
    }
    return t;
}

/// Compares `full` with the simplified lines.
void check(const Drawing& full, const Drawing& simple, double limit, double bound) {
    CHECK(bound <= limit);
    CHECK(simple.lines.size() <= full.lines.size());
    CHECK(one_sided(full, simple, 2) <= bound * (1 + 1e-6) + 1e-9);
    const std::size_t samples = 4 + 4 * full.lines.size() / (simple.lines.size() + 1);
    CHECK(one_sided(simple, full, static_cast<int>(std::min<std::size_t>(samples, 200))) <=
          bound * (1 + 1e-6) + 1e-9);
    const Kept before = topology(full);
    const Kept after = topology(simple);
    CHECK(after.chains == before.chains);
    CHECK(after.loops == before.loops);
    CHECK(after.shortest_loop >= std::min<std::size_t>(before.shortest_loop, 3));
    CHECK(after.points_without_lines == 0);
    const std::set<Point> points(full.points.begin(), full.points.end());
    CHECK(std::all_of(simple.points.begin(), simple.points.end(),
                      [&](const Point& p) { return points.count(p) == 1; }));
    for (const auto& line : simple.lines) {
        CHECK(simple.points[line[0]] != simple.points[line[1]]);
    }
}

struct Simplified {
    Drawing lines;
    double bound = 0;
};

Simplified simplify(const Drawing& full, double limit, int threads = 2, int flat_axis = 2) {
    const auto folder = std::filesystem::temp_directory_path();
    ScratchMesh mesh(folder);
    MeshLayout layout;
    layout.corners = 2;
    layout.vertices = full.points.size();
    layout.elements = full.lines.size();
    mesh.begin(layout);
    mesh.add_vertices({0, full.points, {}, 0});
    std::vector<ElementCorners> corners;
    for (const auto& line : full.lines) {
        corners.push_back({line[0], line[1], line[1]});
    }
    mesh.add_elements({0, corners, {}, {}});
    mesh.end();
    Simplified s;
    Workers(threads).execute([&] {
        const SimplifiedLines lines(mesh, mesh.corners(), flat_axis, limit, folder,
                                    silent_progress());
        MeshCollector collector;
        emit_elements(mesh, lines.corners(), folder, collector, silent_progress());
        s = {drawing_of(collector), lines.bound()};
    });
    return s;
}

Simplified checked(const Drawing& full, double limit) {
    CAPTURE(full.lines.size(), limit);
    Simplified s = simplify(full, limit);
    check(full, s.lines, limit, s.bound);
    return s;
}

std::vector<Point> circle(int n, double radius, double x = 0) {
    std::vector<Point> points;
    for (int i = 0; i < n; ++i) {
        const double angle = 2 * M_PI * i / n;
        points.push_back({static_cast<float>(x + radius * std::cos(angle)),
                          static_cast<float>(radius * std::sin(angle)), 0});
    }
    return points;
}

struct Isolines {
    Drawing lines;
    ExtractReport report;
};

Isolines isolines(const Store& store, double iso, double distance, int threads = 2,
                  const std::optional<WorldBox>& box = {}) {
    SurfaceQuery query;
    query.iso = iso;
    query.stop = DistanceBound{distance, false};
    query.box = box;
    ExtractOptions options;
    options.threads = threads;
    MeshCollector collector;
    Isolines found;
    found.report = extract(store, query, collector, options);
    found.lines = drawing_of(collector);
    return found;
}

template <class T>
void check_isolines(FunctionVolume<T>& volume, double iso,
                    const std::optional<WorldBox>& box = {}) {
    const TemporaryFolder folder;
    make_store(volume, folder / "s", with_chunk(8));
    const Store store(folder / "s");
    const Isolines full = isolines(store, iso, 0, 2, box);
    REQUIRE(!full.lines.lines.empty());
    std::size_t before = full.lines.lines.size();
    for (const double distance : {0.1, 0.5, 2.0}) {
        CAPTURE(distance);
        const Isolines simple = isolines(store, iso, distance, 2, box);
        check(full.lines, simple.lines, distance, simple.report.distance->bound);
        CHECK(simple.report.distance->full_triangles == full.lines.lines.size());
        CHECK(simple.report.triangles == simple.lines.lines.size());
        CHECK(simple.lines.lines.size() <= before);
        before = simple.lines.lines.size();
    }
}

}  // namespace

TEST_CASE("a circle takes as many chords as its sagitta requires") {
    for (const int n : {40, 700, 5000}) {
        Drawing full;
        full.add(circle(n, 100), true);
        full.shuffle();
        for (const double limit : {0.05, 0.5, 5.0}) {
            const Simplified s = checked(full, limit);
            // A chord with this sagitta spans twice this angle, rounded down to whole points.
            const double span = 2 * std::acos(1 - limit / 100);
            const double step = 2 * M_PI / n;
            const double each = std::max(1.0, std::floor(span / step * (1 - 1e-9)));
            const double fewest = std::ceil(n / each);
            const double borders = n > 1024 ? std::ceil(n / 1024.0) : 0;
            CHECK(s.lines.lines.size() <= fewest + 1 + 2 * borders);
            CHECK(static_cast<double>(s.lines.lines.size()) >= std::min(fewest, 3.0));
        }
    }
}

TEST_CASE("spirals, noise and lines in any plane stay within the distance") {
    Drawing full;
    std::vector<Point> spiral;
    for (int i = 0; i < 2500; ++i) {
        const double angle = 0.02 * i;
        const double r = 0.5 * angle;
        spiral.push_back(
            {static_cast<float>(r * std::cos(angle)), static_cast<float>(r * std::sin(angle)), 0});
    }
    full.add(spiral, false);
    std::vector<Point> walk;
    walk.reserve(1500);
    for (int i = 0; i < 1500; ++i) {
        walk.push_back(
            {static_cast<float>(60 + 0.05 * i), static_cast<float>(3 * noise({i, 1, 0})), 0});
    }
    full.add(walk, false);
    full.shuffle();
    for (const double limit : {0.05, 2.0, 1000.0}) {
        const Simplified s = checked(full, limit);
        for (const int axis : {0, 1}) {
            Drawing turned = full;
            for (Point& p : turned.points) {
                std::swap(p[static_cast<std::size_t>(axis)], p[2]);
            }
            CHECK(simplify(turned, limit, 2, axis).lines.lines.size() <=
                  s.lines.lines.size() * 101 / 100);
        }
    }
}

TEST_CASE("a straight line becomes one segment, however long it is") {
    Drawing full;
    std::vector<Point> line;
    line.reserve(9000);
    for (int i = 0; i < 9000; ++i) {
        line.push_back({static_cast<float>(i), static_cast<float>(i % 2), 0});
    }
    full.add(line, false);
    CHECK(simplify(full, 1.0).lines.lines.size() == 1);
    CHECK(simplify(full, 0.25).lines.lines.size() == 8999);
}

TEST_CASE("loops keep three segments and an area, however large the distance") {
    for (const int n : {3, 4, 5, 17, 1024, 1025, 4000}) {
        Drawing full;
        full.add(circle(n, 1), true);
        full.add(circle(n, 0.5, 3), true);
        const Simplified s = checked(full, 100);
        CHECK(s.lines.lines.size() == 6);
        const auto& p = s.lines.points;
        REQUIRE(p.size() == 6);
        const auto area = [&](std::size_t i) {
            return (p[i + 1][0] - p[i][0]) * (p[i + 2][1] - p[i][1]) -
                   (p[i + 2][0] - p[i][0]) * (p[i + 1][1] - p[i][1]);
        };
        CHECK(area(0) != 0);
        CHECK(area(3) != 0);
    }
}

TEST_CASE("points where lines meet are kept, and lines between the same ends stay apart") {
    Drawing full;
    // A wheel whose rim has only one sector, two arcs between the same ends, a drop.
    full.add({{0, 0, 0}, {1, 0.1F, 0}, {2, 0, 0}, {2.2F, 1, 0}, {1.2F, 1.3F, 0}}, false);
    full.lines.push_back({4, 0});
    full.points.insert(full.points.end(), {{-1, 0.1F, 0},
                                           {-2, 0, 0},
                                           {-3, 0.2F, 0},
                                           {-3, -0.4F, 0},
                                           {-2.5F, -0.5F, 0},
                                           {3, 0.1F, 0},
                                           {4, 0, 0}});
    for (const std::array<std::uint32_t, 2>& line : {std::array{0U, 5U},
                                                     {5U, 6U},
                                                     {6U, 7U},
                                                     {7U, 8U},
                                                     {8U, 9U},
                                                     {9U, 6U},
                                                     {2U, 10U},
                                                     {10U, 11U}}) {
        full.lines.push_back(line);
    }
    const Kept t = topology(full);
    CHECK(t.chains.size() == 5);
    CHECK(t.loops == 0);
    const Simplified s = checked(full, 100);
    CHECK(s.lines.lines.size() == 2 + 2 + 2 + 3 + 1);
}

TEST_CASE("simplified lines do not depend on threads") {
    Drawing full;
    for (int i = 0; i < 40; ++i) {
        full.add(circle(30 + 100 * i, 5 + i, 100 * i), true);
    }
    full.shuffle();
    const Simplified one = simplify(full, 0.1, 1);
    const Simplified four = simplify(full, 0.1, 4);
    CHECK(one.lines.points == four.lines.points);
    CHECK(one.lines.lines == four.lines.lines);
    CHECK(one.bound == four.bound);
    CHECK(simplify({}, 1).lines.lines.empty());
}

TEST_CASE("isolines of maps stay within the distance, with holes, in a box, and at plateaus") {
    const auto map = [](const Int3& p) {
        return smooth({p.x, p.y, 3}) + 0.1 * noise({p.x, p.y, 0});
    };
    FunctionVolume<double> plain({61, 50, 1}, map);
    check_isolines(plain, 0.3);
    check_isolines(plain, 0.3, WorldBox{{3.3, 4.6, -1}, {50.2, 40, 1}});
    FunctionVolume<double> rotated({1, 50, 61}, [&](const Int3& p) { return map({p.z, p.y, 0}); });
    check_isolines(rotated, 0.3);
    FunctionVolume<double> holes({61, 50, 1}, [&](const Int3& p) {
        return noise(p, 3) < 0.05 ? std::numeric_limits<double>::quiet_NaN() : map(p);
    });
    check_isolines(holes, 0.3);
    FunctionVolume<std::uint8_t> plateau({50, 50, 1}, [](const Int3& p) {
        return static_cast<std::uint8_t>(std::lround(10 + 3 * smooth({p.x, p.y, 0})));
    });
    check_isolines(plateau, 11);
    FunctionVolume<float> wide({40, 40, 1}, [](const Int3& p) {
        return static_cast<float>(noise({p.x, p.y, 0}));
    });
    check_isolines(wide, 0.5);
}
