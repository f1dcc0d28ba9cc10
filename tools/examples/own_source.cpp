// A volume that is computed, not stored: your own source needs three functions. Errors say what
// went wrong, and what can be done about it.
#include <cmath>
#include <cstdio>
#include <cstring>

#include <isonest/error.h>
#include <isonest/extract.h>
#include <isonest/mesh_file.h>
#include <isonest/preprocess.h>

namespace {

/// The gyroid: A. Schoen, "Infinite periodic minimal surfaces without self-intersections" (1970).
class Gyroid : public isonest::VolumeSource {
  public:
    [[nodiscard]] isonest::VolumeDescription describe() const override {
        return {.nodes = nodes_, .type = isonest::ValueType::f32, .spacing = {0.1, 0.1, 0.1}};
    }
    // Compared when an interrupted run is resumed: other values need another text.
    [[nodiscard]] std::string identity() const override { return "gyroid, period 2 pi\n"; }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        for (std::int64_t z = z0; z < z0 + nz; ++z) {
            for (std::int64_t y = y0; y < y0 + ny; ++y) {
                for (std::int64_t x = 0; x < nodes_.x; ++x) {
                    const float value =
                        at(0.1 * static_cast<double>(x), 0.1 * static_cast<double>(y),
                           0.1 * static_cast<double>(z));
                    std::memcpy(dst, &value, sizeof(value));
                    dst += sizeof(value);
                }
            }
        }
    }

  private:
    static float at(double x, double y, double z) {
        return static_cast<float>(std::sin(x) * std::cos(y) + std::sin(y) * std::cos(z) +
                                  std::sin(z) * std::cos(x));
    }
    isonest::Int3 nodes_{70, 80, 90};
};

}  // namespace

int main() {
    Gyroid gyroid;
    isonest::preprocess(gyroid, "gyroid.isonest", {.force = true});
    const isonest::Store store("gyroid.isonest");
    const isonest::SurfaceQuery query{.iso = 0,
                                      .stop = isonest::ErrorBound{.value = 0.01, .relative = true},
                                      .attributes = {.normals = true}};
    const auto file = isonest::open_mesh_file("gyroid.glb", {.replace = true});
    const auto report = isonest::extract(store, query, *file);
    std::printf("gyroid.glb: %llu triangles\n", static_cast<unsigned long long>(report.triangles));

    // The file exists now, and is replaced only if that is requested.
    try {
        isonest::extract(store, query, *isonest::open_mesh_file("gyroid.glb"));
    } catch (const isonest::Error& error) {
        const bool can_replace =
            !error.remedies().empty() &&
            error.remedies().front().kind == isonest::RemedyKind::replace_existing;
        std::printf("refused: %s%s\n", error.what(), can_replace ? " (MeshFileOptions)" : "");
        return 0;
    }
    return 1;
}
