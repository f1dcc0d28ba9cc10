// The leaves of the whole domain: the smallest and the largest value of each eighth of the volume,
// the number of leaves of each level, and the grid as a file for ParaView.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <vector>

#include <isonest/grid_file.h>
#include <isonest/memory_volume.h>
#include <isonest/preprocess.h>
#include <isonest/traverse.h>

namespace {

using Tetrahedron = isonest::Element<3>;

constexpr isonest::Int3 kNodes{40, 48, 56};

/// Each part of the traversal has its own; they are joined in order.
struct Statistics {
    std::array<double, 8> least{};
    std::array<double, 8> most{};
    std::array<std::uint64_t, 24> leaves{};

    Statistics() {
        least.fill(std::numeric_limits<double>::infinity());
        most.fill(-std::numeric_limits<double>::infinity());
    }
    void operator()(const Tetrahedron& t) {
        const auto [low, high] = t.bounds();
        const isonest::Int3 twice = low + high;
        const auto eighth =
            static_cast<std::size_t>((twice.x < kNodes.x ? 0 : 1) + (twice.y < kNodes.y ? 0 : 2) +
                                     (twice.z < kNodes.z ? 0 : 4));
        const auto [smallest, largest] = t.range();
        least[eighth] = std::min(least[eighth], smallest);
        most[eighth] = std::max(most[eighth], largest);
        ++leaves[static_cast<std::size_t>(t.level)];
    }
    [[nodiscard]] Statistics fork() const { return {}; }
    void join(const Statistics& part) {
        for (std::size_t i = 0; i < least.size(); ++i) {
            least[i] = std::min(least[i], part.least[i]);
            most[i] = std::max(most[i], part.most[i]);
        }
        for (std::size_t i = 0; i < leaves.size(); ++i) {
            leaves[i] += part.leaves[i];
        }
    }
};

}  // namespace

int main() {
    // A sharp layer around a sphere, and little else.
    std::vector<float> u;
    for (std::int64_t i = 0; i < kNodes.product(); ++i) {
        const isonest::Int3 p = kNodes.unlinear(i);
        const double distance =
            std::hypot(static_cast<double>(p.x) - 18.5, static_cast<double>(p.y) - 24.5,
                       static_cast<double>(p.z) - 30.5);
        u.push_back(static_cast<float>(std::tanh(15 - distance)));
    }
    isonest::MemoryVolume volume(u.data(), kNodes, {.spacing = {0.5, 0.5, 1}});
    isonest::preprocess(volume, "layer.isonest", {.force = true});
    const isonest::Store store("layer.isonest");
    const isonest::StopBelow stop =
        isonest::stop_below(store, isonest::ErrorBound{.value = 0.05, .relative = true});

    Statistics all;
    isonest::for_each_leaf<3>(store, stop, all);
    for (std::size_t i = 0; i < all.least.size(); ++i) {
        std::printf("eighth %zu: %.3f to %.3f\n", i, all.least[i], all.most[i]);
    }
    for (std::size_t level = 0; level < all.leaves.size(); ++level) {
        if (all.leaves[level] > 0) {
            std::printf("level %zu: %llu leaves\n", level,
                        static_cast<unsigned long long>(all.leaves[level]));
        }
    }

    isonest::GridFile file("layer.vtu", store);
    isonest::for_each_leaf<3>(store, stop,
                              isonest::in_order<3>([&](const Tetrahedron& t) { file.add(t); }));
    file.close();
    std::printf("layer.vtu: %llu tetrahedra\n", static_cast<unsigned long long>(file.cells()));
}
