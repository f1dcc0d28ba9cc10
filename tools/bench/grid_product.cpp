// z = A w on implicit grids: unknowns per second and bytes per unknown, uniform and adaptive,
// compared with the speed at which this machine copies memory.
//
// usage: isonest_grid_product [N [THREADS [NOISE]]]        (129 1 0.002)
//
// The function is a smoothed ball in noise on N^3 nodes; adaptive grids are those of the threshold
// that leaves about a fifth of the nodes. The coefficients are those of Perona and Malik, computed
// from the function in every product, or assembled once. Each time is the median of seven, that of
// the hash table a single one.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <vector>

#include "query/finite_elements/active_nodes.h"
#include "query/finite_elements/grid_elements.h"
#include "query/finite_elements/grid_operator.h"

using namespace isonest;
using namespace isonest::detail;

namespace {

template <class F>
double median_seconds(const F& f, int rounds = 7) {
    std::vector<double> times;
    for (int i = 0; i < rounds; ++i) {
        const auto start = std::chrono::steady_clock::now();
        f();
        times.push_back(
            std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    }
    std::sort(times.begin(), times.end());
    return times[times.size() / 2];
}

void measure(const char* name, const Lattice& lattice, const NodeSet& set,
             const std::vector<float>& values, int threads) {
    std::vector<float> w;
    for (std::int64_t i = 0; i < lattice.nodes().product(); ++i) {
        if (set.contains(lattice.nodes().unlinear(i))) {
            w.push_back(values[static_cast<std::size_t>(i)]);
        }
    }
    std::vector<float> z(w.size());
    GridOperator<float> op(lattice, {1, 1, 1}, set, threads);
    const double plain = median_seconds([&] { op.stiffness({}, 1, w, z); });
    const double weighted = median_seconds([&] { op.stiffness({w, 0.1}, 1, w, z); });
    const auto count = static_cast<double>(w.size());
    const double copy = median_seconds([&] { std::memcpy(z.data(), w.data(), w.size() * 4); });
    fmt::print(
        "{}: {} unknowns of {} nodes; a = 1: {:.1f} M/s; a = g(|grad|): {:.1f} M/s; copy {:.2f} "
        "GB/s; nodes {:.2f} bytes per unknown\n",
        name, w.size(), values.size(), count / plain / 1e6, count / weighted / 1e6,
        8 * count / copy / 1e9, static_cast<double>(set.heap()) / count);
    std::vector<float> mass(w.size());
    std::vector<float> diagonal(w.size());
    std::optional<GridMatrix<float>> matrix;
    const double assembled = median_seconds([&] {
        matrix = op.assemble({w, 0.1}, 1, mass, diagonal, ~std::uint64_t{0});
    });
    const double product =
        median_seconds([&] { op.workers().execute([&] { matrix->multiply(mass, w, z); }); });
    fmt::print(
        "   assembled in {:.1f} ms, product {:.2f} ms, {:.1f} M/s; {:.2f} edges and {:.1f} bytes "
        "per unknown\n",
        1e3 * assembled, 1e3 * product, count / product / 1e6,
        static_cast<double>(matrix->edges()) / count, static_cast<double>(matrix->heap()) / count);
    HashedNumbering hashed;
    std::uint64_t elements = 0;
    const ActiveNumbers active(set);
    const double visit = median_seconds(
        [&] {
            hashed = {};
            elements = 0;
            for_each_element<3>(
                lattice, WithinVolume{set.nodes() - Int3{1, 1, 1}},
                [&](const Element<3>& t) {
                    return active.indicator(t.ref_node(), Field::values) != 0;
                },
                hashed, [&](const NumberedElement<3>&) { ++elements; });
        },
        1);
    fmt::print(
        "   {:.1f} ms and {:.1f} ms; {} elements, visited with the hash table in {:.1f} ms, which "
        "takes {:.1f} bytes per node\n",
        1e3 * plain, 1e3 * weighted, elements, 1e3 * visit,
        static_cast<double>(hashed.heap()) / count);
}

}  // namespace

int main(int argc, char** argv) {
    const std::int64_t n = argc > 1 ? std::atoll(argv[1]) : 129;
    const int threads = argc > 2 ? std::atoi(argv[2]) : 1;
    const Lattice lattice({n, n, n});
    std::vector<float> values(static_cast<std::size_t>(n * n * n));
    const double noise_part = argc > 3 ? std::atof(argv[3]) : 0.002;
    std::uint64_t state = 1;
    for (std::int64_t i = 0; i < n * n * n; ++i) {
        const Int3 p = lattice.nodes().unlinear(i);
        const auto c = static_cast<double>(n - 1) / 2;
        const double r = std::hypot(static_cast<double>(p.x) - c, static_cast<double>(p.y) - c,
                                    static_cast<double>(p.z) - c);
        state = state * 6364136223846793005U + 1442695040888963407U;
        const double noise = static_cast<double>(state >> 40U) * 0x1p-24 - 0.5;
        values[static_cast<std::size_t>(i)] =
            static_cast<float>(1 / (1 + std::exp((r - 0.7 * c) / 2)) + noise_part * noise);
    }
    NodeSet all;
    fmt::print(
        "grid of all nodes: {:.1f} ms\n",
        1e3 * median_seconds([&] {
            all = active_nodes<float>(lattice, {1, 1, 1}, values, 0, threads, silent_progress());
        }));
    measure("uniform", lattice, all, values, threads);
    double low = 0;
    double high = 1;
    NodeSet some;
    for (int i = 0; i < 12; ++i) {
        const double threshold = (low + high) / 2;
        some =
            active_nodes<float>(lattice, {1, 1, 1}, values, threshold, threads, silent_progress());
        (static_cast<double>(some.count()) > 0.2 * static_cast<double>(values.size()) ? low
                                                                                      : high) =
            threshold;
    }
    measure("adaptive", lattice, some, values, threads);
    return 0;
}
