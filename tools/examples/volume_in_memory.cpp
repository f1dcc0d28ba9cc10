// A volume in memory becomes a store; the store gives triangles in memory.
#include <cmath>
#include <cstdio>
#include <vector>

#include <isonest/extract.h>
#include <isonest/memory_volume.h>
#include <isonest/preprocess.h>

int main() {
    constexpr int n = 65;
    std::vector<float> distance;  // from the centre, x fastest
    for (int i = 0; i < n * n * n; ++i) {
        distance.push_back(std::hypot(static_cast<float>(i % n - n / 2),
                                      static_cast<float>(i / n % n - n / 2),
                                      static_cast<float>(i / n / n - n / 2)));
    }
    isonest::MemoryVolume volume(distance.data(), {n, n, n});
    isonest::preprocess(volume, "ball.isonest", {.force = true});

    const isonest::Store store("ball.isonest");
    isonest::MeshCollector mesh;
    const auto report = isonest::extract(
        store, isonest::SurfaceQuery{.iso = 25, .stop = isonest::ErrorBound{.value = 0.5}}, mesh);
    std::printf("%zu vertices, %zu triangles, error at most %g\n", mesh.vertices.size(),
                mesh.triangles.size(), report.error_bound);
}
