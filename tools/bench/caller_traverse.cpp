// The cost of adapt_traverse() with the caller's functions, compared with the library's own
// traversals on the same store, with the same tests.
//
// usage: isonest_caller_traverse STORE ISOVALUE ERROR [ROUNDS]
//
// ERROR: a fraction of the data's range; 0 is full resolution. One thread; the least processor
// time of the rounds. Rows: the traversal of isosurfaces (bricks), which also makes the triangles;
// the driver of adapt_traverse() with the library's tests and numbers; adapt_traverse() with
// lambdas that count, without a sum and with a sum over the leaves' triangles; the last in order.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include <isonest/error.h>
#include <isonest/traverse.h>

#include "query/traverse/each_leaf.h"
#include "query/traverse/traversal.h"
#include "store/base/workers.h"
#include "store/container/reader.h"
#include "tools/bench/run_program.h"

using namespace isonest;
using namespace isonest::detail;

namespace {

constexpr std::uint64_t kCache = std::uint64_t{512} << 20U;

struct Row {
    std::string name;
    std::function<std::pair<std::uint64_t, std::uint64_t>()> run;  ///< visited, leaves
};

void compare(const std::vector<Row>& rows, int rounds) {
    std::vector<double> seconds(rows.size(), std::numeric_limits<double>::infinity());
    std::vector<std::pair<std::uint64_t, std::uint64_t>> counts(rows.size());
    for (int round = 0; round < rounds; ++round) {
        for (std::size_t i = 0; i < rows.size(); ++i) {
            const std::clock_t start = std::clock();
            counts[i] = rows[i].run();
            const auto time = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
            seconds[i] = std::min(seconds[i], time);
        }
    }
    fmt::print("{:<40} {:>12} {:>12} {:>9} {:>7} {:>12}\n", "", "visited", "leaves", "seconds",
               "ratio", "ns/visit");
    for (std::size_t i = 0; i < rows.size(); ++i) {
        fmt::print("{:<40} {:>12} {:>12} {:>9.3f} {:>7.2f} {:>12.1f}\n", rows[i].name,
                   counts[i].first, counts[i].second, seconds[i], seconds[i] / seconds[0],
                   seconds[i] / static_cast<double>(counts[i].first) * 1e9);
    }
}

/// Twice the area of a leaf's surface, in lattice units: triangles of marching tetrahedra.
double twice_area(const Element<3>& t, double iso) {
    std::array<Double3, 4> cut{};
    std::size_t count = 0;
    std::array<std::size_t, 4> order{0, 1, 2, 3};
    std::stable_partition(order.begin(), order.end(),
                          [&](std::size_t i) { return t.value[i] < iso; });
    for (std::size_t a = 0; a < 4; ++a) {
        for (std::size_t b = a + 1; b < 4; ++b) {
            const double low = t.value[order[a]];
            const double high = t.value[order[b]];
            if ((low < iso) == (high < iso)) {
                continue;
            }
            const double s = (iso - low) / (high - low);
            for (int axis = 0; axis < 3; ++axis) {
                const auto from = static_cast<double>(t.v[order[a]][axis]);
                cut[count][static_cast<std::size_t>(axis)] =
                    from + s * (static_cast<double>(t.v[order[b]][axis]) - from);
            }
            ++count;
        }
    }
    const auto area = [&](std::size_t a, std::size_t b, std::size_t c) {
        const auto minus = [](const Double3& p, const Double3& q) {
            return Double3{p[0] - q[0], p[1] - q[1], p[2] - q[2]};
        };
        return length(cross(minus(cut[b], cut[a]), minus(cut[c], cut[a])));
    };
    // Four points come in the order 02, 03, 12, 13.
    return count == 3 ? area(0, 1, 2) : count == 4 ? area(0, 1, 3) + area(0, 3, 2) : 0;
}

/// A sum for each part of the traversal.
struct Area {
    double iso = 0;
    double twice = 0;
    void operator()(const Element<3>& t) { twice += twice_area(t, iso); }
    [[nodiscard]] Area fork() const { return {iso, 0}; }
    void join(const Area& part) { twice += part.twice; }
};

int measure(int argc, char** argv) {
    if (argc < 4) {
        fmt::print(stderr, "usage: isonest_caller_traverse STORE ISOVALUE ERROR [ROUNDS]\n");
        return 2;
    }
    const Store store(argv[1]);
    const double iso = std::atof(argv[2]);
    const StopBelow stop =
        stop_below(store, ErrorBound{.value = std::atof(argv[3]), .relative = true});
    const int rounds = argc > 4 ? std::atoi(argv[4]) : 5;
    const StoreLayout& layout = store.reader().layout();
    const Tolerance tolerance(stop.threshold, {}, {}, layout.header().steps(),
                              layout.header().origin);
    const TraverseOptions options{.memory = 2 * kCache, .threads = 1};
    const auto of = [](const TraverseReport& report) {
        return std::pair(report.visited, report.leaves);
    };
    const auto interest = [iso](const Element<3>& t, const Indicators& eta) {
        const auto [low, high] = t.range();
        if (low <= iso && iso <= high) {
            return true;
        }
        const double beta = eta(Field::deviation_bar);
        return !(low - beta > iso) && !(high + beta < iso);
    };
    const auto accurate = [threshold = stop.threshold](const Element<3>&, const Indicators& eta) {
        return threshold > 0 && eta(Field::deviation_bar) < threshold;
    };
    std::uint64_t count = 0;
    Area area{iso, 0};
    compare(
        {{"bricks, with triangles",
          [&] {
              ChunkCache cache(store.reader(), kCache);
              TraversalQuery query;
              query.iso = iso;
              query.tolerance = tolerance;
              query.box = volume_box(layout.lattice());
              return Workers(1).execute([&] {
                  const TraversalCounts counts = traverse(
                      cache, query, 65536, [](std::uint64_t, const MeshPart&) {},
                      silent_progress());
                  return std::pair(counts.visited, counts.leaves);
              });
          }},
         {"AdaptTraverse, the library's tests",
          [&] {
              ChunkCache cache(store.reader(), kCache);
              StoreNumbers numbers(cache);
              AdaptTraverse<Element<3>, StoreNumbers, InBox, HoldsIsovalue, StopsBelow> traversal(
                  numbers, InBox{volume_box(layout.lattice())},
                  HoldsIsovalue{iso, Field::deviation_bar, layout.header().steps()},
                  StopsBelow{tolerance, Field::deviation_bar});
              auto nothing = [](const Element<3>&, double, Overlap) {};
              for (const Element<3>& t : traversal.roots(layout.lattice())) {
                  traversal.subtree(t, nothing);
              }
              return std::pair(traversal.counts().visited, traversal.counts().leaves);
          }},
         {"adapt_traverse(), lambdas, counting",
          [&] {
              return of(adapt_traverse<3>(
                  store, interest, accurate, [&](const Element<3>&) { ++count; }, options));
          }},
         {"adapt_traverse(), area of the surface",
          [&] { return of(adapt_traverse<3>(store, interest, accurate, area, options)); }},
         {"the same, in order",
          [&] {
              return of(adapt_traverse<3>(
                  store, interest, accurate,
                  in_order<3>([&](const Element<3>& t) { area.twice += twice_area(t, iso); }),
                  options));
          }}},
        rounds);
    fmt::print("area {:.6g}, {} leaves counted\n", area.twice / 2, count);
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    return bench::run_program("isonest_caller_traverse", [&] { return measure(argc, argv); });
}
