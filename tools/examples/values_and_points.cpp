// Reads a store without a mesh: a box of a level, an indicator, values along a line, and the
// histogram.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <vector>

#include <isonest/histogram.h>
#include <isonest/memory_volume.h>
#include <isonest/preprocess.h>
#include <isonest/values.h>

int main() {
    // u = x + 2 y + 3 z on 33^3 nodes, half a world unit apart.
    std::vector<float> u;
    for (int i = 0; i < 33 * 33 * 33; ++i) {
        u.push_back(static_cast<float>(0.5 * (i % 33) + 1.0 * (i / 33 % 33) + 1.5 * (i / 1089)));
    }
    isonest::MemoryVolume volume(u.data(), {33, 33, 33}, {.spacing = {0.5, 0.5, 0.5}});
    isonest::preprocess(volume, "linear.isonest", {.force = true});
    const isonest::Store store("linear.isonest");

    // 3 x 2 x 1 nodes of level 2, which has every fourth node: (4, 4, 8), (8, 4, 8) ...
    std::vector<float> box(3 * 2 * 1);
    isonest::read_values(store, 2, {{1, 1, 2}, {3, 2, 1}}, std::span(box));
    std::printf("level 2:");
    for (const float value : box) {
        std::printf(" %g", static_cast<double>(value));
    }

    // A coarse grid has a linear function without error.
    const isonest::Int3 nodes = isonest::nodes_of_level(store, 0);
    std::vector<double> eta(static_cast<std::size_t>(nodes.product()));
    isonest::read_indicator(store, isonest::Field::deviation_bar, 0, {{}, nodes}, eta);
    double largest = 0;
    for (const double e : eta) {
        largest = std::fmax(largest, e);
    }
    std::printf("\nlargest indicator of %zu nodes: %g\n", eta.size(), largest);

    // Points on a line; the last one is outside the volume.
    const std::vector<isonest::Double3> points{{0.1, 0.2, 0.3}, {10.3, 7.7, 5.1}, {25, 7.7, 5.1}};
    std::vector<double> values(points.size());
    isonest::sample(store, points, values);
    std::printf("points:");
    for (const double value : values) {
        std::printf(" %.6g", value);
    }

    const isonest::Histogram histogram = isonest::histogram(store);
    std::uint64_t counted = 0;
    for (const std::uint64_t n : histogram.nodes) {
        counted += n;
    }
    std::printf("\nhistogram: %d bins, %llu nodes\n", histogram.bins.count(),
                static_cast<unsigned long long>(counted));
}
