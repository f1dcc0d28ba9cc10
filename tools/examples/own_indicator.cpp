// Your own indicator: the surface is refined where values change a lot within an element, relative
// to their size. It is a function of a node's diamond; the library saturates and stores it.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include <isonest/extract.h>
#include <isonest/memory_volume.h>
#include <isonest/mesh_file.h>
#include <isonest/own_indicator.h>
#include <isonest/preprocess.h>

int main() {
    const isonest::Int3 nodes{65, 65, 65};
    std::vector<float> values;
    for (std::int64_t i = 0; i < nodes.product(); ++i) {
        const isonest::Int3 p = nodes.unlinear(i);
        values.push_back(std::hypot(static_cast<float>(p.x - 32), static_cast<float>(p.y - 30),
                                    static_cast<float>(p.z - 34)));
    }
    isonest::MemoryVolume volume(values.data(), nodes);

    // The largest difference of two values in an element, over the value at the node.
    const auto spread = [](const isonest::RefinementNode& x) {
        double most = 0;
        for (const isonest::RefinedElement& t : x.elements) {
            const auto* const end = t.values.data() + t.count;
            const auto [low, high] = std::minmax_element(t.values.data(), end);
            most = std::max(most, *high - *low);
        }
        return most / (1 + std::fabs(x.value));
    };
    isonest::PreprocessOptions options{
        .force = true, .fields = {isonest::Field::linf_bar, isonest::Field::deviation_bar}};
    // The formula of linf, for comparison.
    options.own = {isonest::own_indicator("spread", spread),
                   isonest::own_indicator("offset", [](const isonest::RefinementNode& x) {
                       return std::fabs(x.offset());
                   })};
    isonest::preprocess(volume, "own.isonest", options);

    const isonest::Store store("own.isonest");
    const auto triangles = [&](isonest::Field field, double threshold) {
        const isonest::SurfaceQuery query{.iso = 20,
                                          .stop = isonest::FieldThreshold{field, threshold},
                                          .effort = isonest::Effort::none};
        const auto file = isonest::open_mesh_file("own.ply", {.replace = true});
        return static_cast<unsigned long long>(isonest::extract(store, query, *file).triangles);
    };
    using isonest::Saturation;
    for (const double threshold : {0.05, 0.1, 0.2}) {
        std::printf("spread below %g: %llu triangles\n", threshold,
                    triangles(isonest::own_field("spread", Saturation::bar), threshold));
    }
    std::printf("offset: %llu triangles, linf: %llu\n",
                triangles(isonest::own_field("offset", Saturation::bar), 0.1),
                triangles(isonest::Field::linf_bar, 0.1));
}
