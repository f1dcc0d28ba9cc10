// The errors of section 3 of the paper, and the distance of graphs, compared with sums over many
// points.
#include "query/study/true_error.h"

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include <isonest/error.h>

#include "query/study/graph_distance.h"
#include "query/study/study.h"
#include "tests/support/loaded_lattice.h"
#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

constexpr Double3 kSpacing{1, 0.5, 2};

struct Sample {
    std::vector<double> value;  ///< of U and of P U
    std::array<Double3, 2> slope{};
    bool complete = true;
};

/// U and P U at a point, by sorting the coordinates in its cell: does not need a list of elements.
Sample sample_at(const WholeLattice& whole, const Double3& p) {
    const Int3 n = whole.lattice().nodes();
    std::vector<std::size_t> axes;
    Int3 node;
    std::array<double, 3> along{};
    std::array<std::int64_t, 3> step{};
    for (std::size_t a = 0; a < 3; ++a) {
        const int axis = static_cast<int>(a);
        if (n[axis] == 1) {
            continue;
        }
        const auto low = std::min(static_cast<std::int64_t>(p[a]), n[axis] - 2);
        node[axis] = low + (low & 1);
        step[a] = (low & 1) != 0 ? -1 : 1;
        along[a] = std::fabs(p[a] - static_cast<double>(node[axis]));
        axes.push_back(a);
    }
    std::sort(axes.begin(), axes.end(),
              [&](std::size_t a, std::size_t b) { return along[a] > along[b]; });
    const auto both = [&](const Int3& q) { return std::array{whole.exact(q), whole.projected(q)}; };
    std::array<double, 2> at = both(node);
    Sample sample{{at[0], at[1]}, {}, std::isfinite(at[0]) && std::isfinite(at[1])};
    for (const std::size_t a : axes) {
        node[static_cast<int>(a)] += step[a];
        const std::array<double, 2> next = both(node);
        for (std::size_t i = 0; i < 2; ++i) {
            const double slope = next[i] - at[i];
            sample.value[i] += along[a] * slope;
            sample.slope[i][a] = slope * static_cast<double>(step[a]) / kSpacing[a];
            sample.complete = sample.complete && std::isfinite(next[i]);
        }
        at = next;
    }
    return sample;
}

/// A random point in each of the small boxes that fill the volume.
template <class F>
void for_points(const Int3& n, int per_cell, const F& f) {
    Int3 count;
    for (int axis = 0; axis < 3; ++axis) {
        count[axis] = std::max<std::int64_t>((n[axis] - 1) * per_cell, 1);
    }
    for (std::int64_t i = 0; i < count.product(); ++i) {
        const Int3 at = count.unlinear(i);
        Double3 p{};
        for (std::size_t a = 0; a < 3; ++a) {
            const int axis = static_cast<int>(a);
            p[a] = n[axis] == 1 ? 0 : (static_cast<double>(at[axis]) + noise(at, a)) / per_cell;
        }
        f(p);
    }
}

struct Projection : LoadedLattice {
    Projection(const Int3& n, bool holes, double threshold)
        : LoadedLattice(
              n,
              [&](const Int3& p) {
                  const bool hole = holes && p.x == 3 && p.y == 2;
                  return hole ? std::numeric_limits<double>::quiet_NaN()
                              : smooth(p) + 0.2 * noise(p);
              },
              kSpacing, with_chunk(8, true)) {
        const double largest = whole->load_indicator(*cache, Field::linf_bar, silent_progress());
        whole->project(threshold * largest);
    }
};

double norm(const Double3& v) {
    return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

}  // namespace

TEST_CASE("the errors of value and gradient agree with sums over many points") {
    for (const Int3& n :
         {Int3{9, 9, 9}, Int3{7, 12, 5}, Int3{17, 9, 1}, Int3{1, 12, 17}, Int3{1, 33, 1}}) {
        for (const bool holes : {false, true}) {
            const Projection p(n, holes, 0.3);
            const int per_cell = p.whole->lattice().dimension() == 3 ? 8 : 60;
            for (const double power : {1.0, 2.0, 3.5}) {
                CAPTURE(n.x, n.y, n.z, holes, power);
                double count = 0;
                double value = 0;
                double gradient = 0;
                double of_data = 0;
                double largest = 0;
                double largest_of_data = 0;
                for_points(n, per_cell, [&](const Double3& at) {
                    const Sample s = sample_at(*p.whole, at);
                    if (!s.complete) {
                        return;
                    }
                    Double3 d{};
                    for (std::size_t a = 0; a < 3; ++a) {
                        d[a] = s.slope[1][a] - s.slope[0][a];
                    }
                    count += 1;
                    value += std::pow(std::fabs(s.value[1] - s.value[0]) / p.range(), power);
                    gradient += std::pow(norm(d), power);
                    of_data += std::pow(norm(s.slope[0]), power);
                    largest = std::max(largest, norm(d));
                    largest_of_data = std::max(largest_of_data, norm(s.slope[0]));
                });
                const TrueNorms found = TrueError(*p.whole, kSpacing, p.range(), power).measure();
                CHECK(found.value > 0);
                CHECK(found.value == Approx(std::pow(value / count, 1 / power)).epsilon(0.02));
                CHECK(found.gradient ==
                      Approx(std::pow(gradient / of_data, 1 / power)).epsilon(0.02));
                CHECK(found.gradient_linf == Approx(largest / largest_of_data));
            }
        }
    }
}

TEST_CASE("the distance from a point to a simplex is the minimum over the simplex's points") {
    std::mt19937 chance(11);
    std::uniform_real_distribution<double> any(-1, 1);
    for (std::size_t count = 1; count <= 4; ++count) {
        for (int i = 0; i < 60; ++i) {
            std::vector<GraphPoint> v(count);
            GraphPoint p{};
            for (std::size_t a = 0; a < 4; ++a) {
                p[a] = 1.5 * any(chance);
                for (GraphPoint& vertex : v) {
                    vertex[a] = any(chance);
                }
            }
            // Random weights, then closer and closer to the best.
            double best = std::numeric_limits<double>::infinity();
            std::vector<double> weights(count, 1.0 / static_cast<double>(count));
            for (int k = 0; k < 6000; ++k) {
                std::vector<double> w = weights;
                double sum = 0;
                for (double& x : w) {
                    x = std::max(0.0, x + any(chance) * std::pow(0.998, k));
                    sum += x;
                }
                double square = 0;
                for (std::size_t a = 0; a < 4 && sum > 0; ++a) {
                    double at = 0;
                    for (std::size_t j = 0; j < count; ++j) {
                        at += w[j] / sum * v[j][a];
                    }
                    square += (p[a] - at) * (p[a] - at);
                }
                if (sum > 0 && square < best) {
                    best = square;
                    for (std::size_t j = 0; j < count; ++j) {
                        weights[j] = w[j] / sum;
                    }
                }
            }
            CAPTURE(count, i);
            CHECK(distance_to_simplex(p, v) <= std::sqrt(best) * (1 + 1e-9));
            CHECK(distance_to_simplex(p, v) == Approx(std::sqrt(best)).epsilon(0.01).margin(1e-3));
        }
    }
}

TEST_CASE(
    "the distance of graphs is the maximum over all nodes of the distance to the other graph") {
    for (const Int3& n : {Int3{5, 6, 4}, Int3{9, 6, 1}, Int3{17, 1, 1}}) {
        for (const double threshold : {0.9, 0.3}) {
            for (const bool holes : {false, true}) {
                const Projection p(n, holes && n.y > 1, threshold);
                double longest = 0;
                for (std::size_t a = 0; a < 3; ++a) {
                    longest = std::max(
                        longest, kSpacing[a] * static_cast<double>(n[static_cast<int>(a)] - 1));
                }
                std::array<std::vector<GraphPoint>, 2> graphs;
                const int per_cell = n.z > 1 ? 20 : n.y > 1 ? 60 : 500;
                const auto add = [&](const Double3& at) {
                    const Sample s = sample_at(*p.whole, at);
                    for (std::size_t g = 0; g < 2 && s.complete; ++g) {
                        graphs[g].push_back(
                            {at[0] * kSpacing[0] / longest, at[1] * kSpacing[1] / longest,
                             at[2] * kSpacing[2] / longest, s.value[g] / p.range()});
                    }
                };
                for_points(n, per_cell, add);
                double furthest = 0;
                for (std::int64_t i = 0; i < n.product(); ++i) {
                    const Int3 node = n.unlinear(i);
                    for (std::size_t g = 0; g < 2; ++g) {
                        const double value =
                            g == 0 ? p.whole->exact(node) : p.whole->projected(node);
                        const double error = p.whole->exact(node) - p.whole->projected(node);
                        if (!std::isfinite(error)) {
                            continue;
                        }
                        double nearest = std::fabs(error) / p.range();
                        for (const GraphPoint& q : graphs[1 - g]) {
                            double square = 0;
                            for (std::size_t a = 0; a < 3; ++a) {
                                const double d = static_cast<double>(node[static_cast<int>(a)]) *
                                                     kSpacing[a] / longest -
                                                 q[a];
                                square += d * d;
                            }
                            square += (value / p.range() - q[3]) * (value / p.range() - q[3]);
                            nearest = std::min(nearest, std::sqrt(square));
                        }
                        furthest = std::max(furthest, nearest);
                    }
                }
                CAPTURE(n.x, n.y, n.z, threshold, holes);
                const double found =
                    graph_distance(*p.whole, kSpacing, p.range(), silent_progress());
                CHECK(furthest > 0);
                CHECK(found <= furthest * (1 + 1e-9));
                CHECK(found == Approx(furthest).epsilon(0.08));
            }
        }
    }
}

TEST_CASE("a study has the errors of section 3 on request, and refuses invalid queries") {
    const Projection p({9, 9, 9}, false, 0.3);
    StudyOptions options;
    options.fields = {Field::linf_bar};
    options.steps = 3;
    options.least = 1e-3;
    options.power = 2;
    options.graphs = true;
    const Study s = study(*p.store, options, silent_progress());
    for (std::size_t i = 1; i < s.rows.size(); ++i) {
        CHECK(s.rows[i].true_norms.value < s.rows[i - 1].true_norms.value);
        CHECK(s.rows[i].true_norms.gradient < s.rows[i - 1].true_norms.gradient);
        CHECK(s.rows[i].graph_distance <= s.rows[i].norms.linf);
        CHECK(s.rows[i].graph_distance < s.rows[i - 1].graph_distance);
    }
    options.power = 0.5;
    CHECK_THROWS_AS(study(*p.store, options, silent_progress()), Error);
    options.power = 2;
    options.plane = WorldPlane{{0, 0, 1}, 4};
    CHECK_THROWS_AS(study(*p.store, options, silent_progress()), Error);
}
