// The paper's AdaptTraverse with your own functions: a function is integrated over the adaptive
// grid, by z = M w with the mass matrix M of the grid, as in section 7. No element is stored.
#include <array>
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>
#include <tuple>
#include <vector>

#include <isonest/memory_volume.h>
#include <isonest/preprocess.h>
#include <isonest/traverse.h>

using Tetrahedron = isonest::Element<3>;
using Numbers = std::array<double, 4>;

namespace {

/// The mass matrix of a tetrahedron with linear functions.
std::array<Numbers, 4> mass_matrix(double volume) {
    std::array<Numbers, 4> m{};
    for (std::size_t i = 0; i < 4; ++i) {
        m[i].fill(volume / 20);
        m[i][i] = volume / 10;
    }
    return m;
}

Numbers product(const std::array<Numbers, 4>& m, const Numbers& w) {
    Numbers z{};
    for (std::size_t i = 0; i < 4; ++i) {
        for (std::size_t j = 0; j < 4; ++j) {
            z[i] += m[i][j] * w[j];
        }
    }
    return z;
}

}  // namespace

int main() {
    // sin(pi x) sin(pi y) sin(pi z) on the unit cube.
    constexpr int n = 65;
    std::vector<double> u;
    const auto wave = [](int i) { return std::sin(std::numbers::pi * i / (n - 1)); };
    for (int i = 0; i < n * n * n; ++i) {
        u.push_back(wave(i % n) * wave(i / n % n) * wave(i / n / n));
    }
    isonest::MemoryVolume volume(u.data(), {n, n, n},
                                 {.spacing = {1.0 / (n - 1), 1.0 / (n - 1), 1.0 / (n - 1)}});
    isonest::preprocess(volume, "waves.isonest", {.force = true});
    const isonest::Store store("waves.isonest");
    const isonest::Placement placement(store);
    const double epsilon = 0.01;

    std::map<std::tuple<std::int64_t, std::int64_t, std::int64_t>, double> z;

    const auto simplex_is_of_interest = [](const Tetrahedron&) { return true; };
    const auto stop = [&](const Tetrahedron&, const isonest::Indicators& eta) {
        return eta(isonest::Field::deviation_bar) < epsilon;
    };
    const auto simplex_action = [&](const Tetrahedron& t) {
        const auto local_matrix = mass_matrix(placement.size(t));
        const Numbers local = product(local_matrix, t.value);
        for (std::size_t i = 0; i < 4; ++i) {
            z[{t.v[i].x, t.v[i].y, t.v[i].z}] += local[i];
        }
    };
    const isonest::TraverseReport report = isonest::adapt_traverse<3>(
        store, simplex_is_of_interest, stop, isonest::in_order<3>(simplex_action));

    double integral = 0;
    for (const auto& [node, value] : z) {
        integral += value;
    }
    std::printf("%llu tetrahedra with %zu nodes, integral %.5f\n",
                static_cast<unsigned long long>(report.leaves), z.size(), integral);
}
