// A slice is handed to functions batch by batch: its area and its mean value are summed up without
// a mesh in memory.
#include <cmath>
#include <cstdio>
#include <vector>

#include <isonest/extract.h>
#include <isonest/memory_volume.h>
#include <isonest/preprocess.h>

int main() {
    // u = x + 2 y + 3 z on a lattice of 40 x 30 x 20 nodes, half a world unit apart.
    std::vector<double> u;
    for (int i = 0; i < 40 * 30 * 20; ++i) {
        u.push_back(0.5 * (i % 40) + 1.0 * (i / 40 % 30) + 1.5 * (i / 1200));
    }
    isonest::MemoryVolume volume(u.data(), {40, 30, 20}, {.spacing = {0.5, 0.5, 0.5}});
    isonest::preprocess(volume, "linear.isonest", {.force = true});

    double area = 0;
    double integral = 0;
    std::size_t triangles = 0;
    const isonest::MeshLayout* layout = nullptr;
    isonest::CallbackSink sink({}, [&](const isonest::ElementBatch& batch) {
        const isonest::VertexAttribute& value = *layout->find("value");
        for (const auto& [a, b, c] : batch.nearby_corners) {
            const auto& p = batch.nearby.positions;
            // All of them lie in a plane z = constant.
            const double twice = (p[b][0] - p[a][0]) * (p[c][1] - p[a][1]) -
                                 (p[b][1] - p[a][1]) * (p[c][0] - p[a][0]);
            const double mean = (batch.nearby.number(a, value) + batch.nearby.number(b, value) +
                                 batch.nearby.number(c, value)) /
                                3;
            area += std::fabs(twice) / 2;
            integral += std::fabs(twice) / 2 * mean;
        }
        triangles += batch.corners.size();
    });
    layout = &sink.layout();
    const isonest::SliceQuery query{.plane = {{0, 0, 1}, 4.25},
                                    .stop = isonest::ErrorBound{.value = 1}};
    isonest::extract(isonest::Store("linear.isonest"), query, sink);
    std::printf("%zu triangles, area %.4f, mean value %.4f\n", triangles, area, integral / area);
}
