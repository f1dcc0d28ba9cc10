// Compares a step of nonlinear diffusion on a grid of some nodes with one on all nodes: time and
// difference of the results.
//
// usage: isonest_diffusion_steps VOLUME.raw NX NY NZ [PART [STEPS [THREADS [ROUNDS]]]]
//        isonest_diffusion_steps ball N 0 0 ...
//
// VOLUME.raw: float32, x fastest; `ball`: a smoothed ball in noise on N^3 nodes. PART (0.2) is the
// fraction of nodes that the threshold leaves active in the first step, to within 2 %; STEPS (4)
// follow each other. lambda is 3 % of the range, tau 0.5, sigma 1. Both run in turn, ROUNDS (5)
// times; the seconds are the minimum of the processor time, because other load can only add to it.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <string>
#include <vector>

#include "query/finite_elements/active_nodes.h"
#include "query/finite_elements/nonlinear_diffusion.h"

using namespace isonest;
using namespace isonest::detail;

namespace {

std::vector<float> ball(std::int64_t n) {
    std::vector<float> values;
    const auto c = static_cast<double>(n - 1) / 2;
    std::uint64_t state = 1;
    for (std::int64_t i = 0; i < n * n * n; ++i) {
        const Int3 p = Int3{n, n, n}.unlinear(i);
        const double r = std::hypot(static_cast<double>(p.x) - c, static_cast<double>(p.y) - c,
                                    static_cast<double>(p.z) - c);
        state = state * 6364136223846793005U + 1442695040888963407U;
        const double noise = static_cast<double>(state >> 40U) * 0x1p-24 - 0.5;
        values.push_back(static_cast<float>(1 / (1 + std::exp((r - 0.7 * c) / 2)) + 0.002 * noise));
    }
    return values;
}

/// The results of some steps.
struct Steps {
    std::vector<double> seconds;
    std::vector<SmoothStep> reports;
    std::vector<float> values;
};

Steps run(const Lattice& lattice, const std::vector<float>& values, const SmoothOptions& options,
          int steps) {
    NonlinearDiffusion diffusion(lattice, {1, 1, 1}, values, options);
    Steps out;
    for (int step = 0; step < steps; ++step) {
        const std::clock_t start = std::clock();
        out.reports.push_back(diffusion.step(silent_progress()));
        out.seconds.push_back(static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC);
    }
    out.values.assign(diffusion.values().begin(), diffusion.values().end());
    return out;
}

/// The threshold that leaves this fraction of the nodes active.
double threshold_for(const Lattice& lattice, const std::vector<float>& values, double part,
                     double range) {
    double low = 0;
    double high = range;
    for (int i = 0; i < 40; ++i) {
        const double threshold = (low + high) / 2;
        const auto active = static_cast<double>(
            active_nodes<float>(lattice, {1, 1, 1}, values, threshold, 0, silent_progress())
                .count());
        const double found = active / static_cast<double>(values.size());
        if (std::fabs(found / part - 1) < 0.02) {
            return threshold;
        }
        (found > part ? low : high) = threshold;
    }
    return high;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 5) {
        fmt::print(stderr,
                   "usage: isonest_diffusion_steps VOLUME.raw NX NY NZ [PART [STEPS "
                   "[THREADS [ROUNDS]]]]\n");
        return 2;
    }
    const auto number = [&](int i, double otherwise) {
        return argc > i ? std::atof(argv[i]) : otherwise;
    };
    const bool is_ball = std::string(argv[1]) == "ball";
    const auto n = static_cast<std::int64_t>(number(2, 0));
    const Int3 nodes = is_ball ? Int3{n, n, n}
                               : Int3{n, static_cast<std::int64_t>(number(3, 0)),
                                      static_cast<std::int64_t>(number(4, 0))};
    std::vector<float> values(static_cast<std::size_t>(nodes.product()));
    if (is_ball) {
        values = ball(n);
    } else {
        std::ifstream file(argv[1], std::ios::binary);
        file.read(reinterpret_cast<char*>(values.data()),
                  static_cast<std::streamsize>(values.size() * sizeof(float)));
        if (!file) {
            fmt::print(stderr, "{}: not {} numbers of float32\n", argv[1], values.size());
            return 3;
        }
    }
    const Lattice lattice(nodes);
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    const double range = static_cast<double>(*high) - static_cast<double>(*low);
    const int steps = static_cast<int>(number(6, 4));
    const int rounds = static_cast<int>(number(8, 5));
    SmoothOptions options;
    options.lambda = 0.03 * range;
    options.tau = 0.5;
    options.sigma = 1;
    options.threads = static_cast<int>(number(7, 1));
    SmoothOptions adaptive = options;
    adaptive.threshold = threshold_for(lattice, values, number(5, 0.2), range);

    Steps full;
    Steps some;
    for (int round = 0; round < rounds; ++round) {
        const auto keep_least = [&](Steps& best, const Steps& now) {
            const std::vector<double> before = best.seconds;
            best = now;
            for (std::size_t i = 0; i < before.size(); ++i) {
                best.seconds[i] = std::min(best.seconds[i], before[i]);
            }
        };
        keep_least(full, run(lattice, values, options, steps));
        keep_least(some, run(lattice, values, adaptive, steps));
    }
    fmt::print("{} x {} x {} nodes, threshold {:.2f} % of the range\n", nodes.x, nodes.y, nodes.z,
               100 * adaptive.threshold / range);
    for (std::size_t i = 0; i < full.seconds.size(); ++i) {
        fmt::print(
            "step {}: all nodes {:.0f} ms, {} iterations; {:.1f} % of them {:.0f} ms, {}: {:.2f} "
            "times less\n",
            i + 1, 1e3 * full.seconds[i], full.reports[i].iterations,
            100 * static_cast<double>(some.reports[i].unknowns) /
                static_cast<double>(values.size()),
            1e3 * some.seconds[i], some.reports[i].iterations, full.seconds[i] / some.seconds[i]);
    }
    double mean = 0;
    double squares = 0;
    double most = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
        const double d =
            std::fabs(static_cast<double>(full.values[i]) - static_cast<double>(some.values[i])) /
            range;
        mean += d / static_cast<double>(values.size());
        squares += d * d / static_cast<double>(values.size());
        most = std::max(most, d);
    }
    fmt::print(
        "difference in the end: mean {:.2f} %, root mean square {:.2f} %, largest {:.2f} % "
        "of the range\n",
        100 * mean, 100 * std::sqrt(squares), 100 * most);
    return 0;
}
