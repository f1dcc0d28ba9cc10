// The minimum number of segments for a chain, compared with a search over all pairs of points.
#include <algorithm>
#include <catch2/catch.hpp>

#include "query/simplify/simplify_lines.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

bool is_near(std::span<const PlanePoint> points, std::size_t i, std::size_t j, double limit) {
    for (std::size_t k = i; k <= j; ++k) {
        if (square_distance_to_segment(points[k], points[i], points[j]) > limit * limit) {
            return false;
        }
    }
    return true;
}

/// The minimum by its definition.
std::size_t fewest(std::span<const PlanePoint> points, double limit) {
    std::vector<std::size_t> hops(points.size());
    for (std::size_t j = 1; j < points.size(); ++j) {
        hops[j] = hops[j - 1] + 1;
        for (std::size_t i = 0; i < j; ++i) {
            if (points[i] != points[j] && is_near(points, i, j, limit)) {
                hops[j] = std::min(hops[j], hops[i] + 1);
            }
        }
    }
    return hops.back();
}

std::vector<PlanePoint> wild(int n, int kind) {
    std::vector<PlanePoint> points;
    PlanePoint at{};
    for (int i = 0; i < n; ++i) {
        const double x = noise({i, kind, 0}) - 0.5;
        const double y = noise({i, kind, 1}) - 0.5;
        if (kind % 4 == 0) {  // on a grid: many directions are equal, some points too
            at = {at[0] + std::round(3 * x), at[1] + std::round(3 * y)};
        } else {
            at = {at[0] + x + 0.2 * (kind % 4), at[1] + y};
        }
        points.push_back(at);
    }
    return points;
}

}  // namespace

TEST_CASE("the minimum number of segments is found, on walks, zigzags and grids") {
    FewestSegments search;
    for (int kind = 0; kind < 60; ++kind) {
        const std::vector<PlanePoint> points = wild(2 + 2 * kind, kind);
        for (const double limit : {0.02, 0.3, 0.7, 1.01, 3.0}) {
            CAPTURE(kind, limit);
            const auto kept = search.find(points, limit, 1);
            CHECK(kept.size() == fewest(points, limit) + 1);
            REQUIRE(kept.front() == 0);
            REQUIRE(kept.back() == points.size() - 1);
            for (std::size_t k = 1; k < kept.size(); ++k) {
                REQUIRE(kept[k - 1] < kept[k]);
                CHECK(is_near(points, kept[k - 1], kept[k], limit));
            }
        }
    }
}

TEST_CASE("at least the requested number of segments is kept") {
    FewestSegments search;
    std::vector<PlanePoint> points = wild(50, 3);
    CHECK(search.find(points, 1000, 1).size() == 2);
    CHECK(search.find(points, 1000, 2).size() == 3);
    points.push_back(points.front());
    for (const std::size_t n : {2U, 3U, 4U}) {
        const auto few = std::span(points).first(n);
        CHECK(search.find(few, 1000, static_cast<std::uint32_t>(std::min(n - 1, std::size_t{3})))
                  .size() == n);
    }
    CHECK(search.find(points, 1000, 3).size() == 4);
    // All points on a line except one.
    const std::vector<PlanePoint> flat{{0, 0}, {1, 0}, {2, 0}, {9, 0}, {4, 0}, {3, 0.1}, {0, 0}};
    const auto kept = search.find(flat, 1000, 3);
    CHECK(std::vector<std::uint32_t>(kept.begin(), kept.end()) ==
          std::vector<std::uint32_t>{0, 3, 5, 6});
}
