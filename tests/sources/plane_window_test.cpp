// The window over the planes of the input: planes are there when they are needed, and its memory.
#include "preprocess/sources/wrapping/plane_window.h"

#include <catch2/catch.hpp>
#include <map>

#include "tests/support/test_support.h"

using namespace isonest;
using namespace isonest::detail;
using namespace isonest::detail::test;

namespace {

/// Can only read whole steps, like chunks that are decoded.
class SteppedVolume : public FunctionVolume<std::uint16_t> {
  public:
    SteppedVolume(std::int64_t nz, std::int64_t step)
        : FunctionVolume(
              {3, 2, nz},
              [](const Int3& p) { return static_cast<std::uint16_t>(p.x + 3 * p.y + 6 * p.z); }),
          step_(step) {}
    [[nodiscard]] Granularity granularity() const override { return {step_, 1}; }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        for (std::int64_t s = z0 / step_; s <= (z0 + nz - 1) / step_; ++s) {
            ++decoded_[s];
        }
        FunctionVolume::read(z0, nz, y0, ny, dst);
    }
    /// How often each step was decoded.
    [[nodiscard]] const std::map<std::int64_t, int>& decoded() const { return decoded_; }

  private:
    std::int64_t step_;
    std::map<std::int64_t, int> decoded_;
};

constexpr std::int64_t kPlaneBytes = 3 * 2 * 2;
constexpr std::int64_t kPlanes = 40;  ///< 16-plane rows of blocks with a margin, in pairs

void require_planes(const PlaneWindow& window, std::int64_t begin, std::int64_t end) {
    for (std::int64_t z = begin; z < end; ++z) {
        for (std::int64_t y = 0; y < 2; ++y) {
            std::array<std::uint16_t, 3> row{};
            std::memcpy(row.data(), window.row(y, z), sizeof(row));
            REQUIRE(row[0] == 6 * z + 3 * y);
            REQUIRE(row[2] == 6 * z + 3 * y + 2);
        }
    }
}

/// Walks through the volume like the level pass, from block row `first` on.
void walk(SteppedVolume& volume, PlaneWindow& window, std::int64_t first) {
    const std::int64_t nz = volume.nodes().z;
    const auto begin_of = [&](std::int64_t row) {
        return std::clamp<std::int64_t>(32 * row - 3, 0, nz - 1);
    };
    const auto end_of = [&](std::int64_t row) {
        return std::clamp<std::int64_t>(32 * row + 36, 1, nz);
    };
    for (std::int64_t row = first; 32 * row < nz; ++row) {
        window.load(begin_of(row), end_of(row));
        require_planes(window, begin_of(row), end_of(row));
        window.prefetch(end_of(row + 1));
        require_planes(window, begin_of(row), end_of(row));
    }
}

}  // namespace

TEST_CASE("every plane is there when it is needed, and each step of the input is decoded once") {
    for (const std::int64_t nz : {1, 2, 39, 40, 64, 97, 200, 257}) {
        for (const std::int64_t step : {1, 2, 5, 16, 32, 64, 100, 300}) {
            if (step > nz) {
                continue;
            }
            for (const std::int64_t planes : {40, 42, 44, 48, 60, 64, 71, 79, 96, 103, 139, 1000}) {
                SteppedVolume volume(nz, step);
                const TemporaryFolder folder;
                const auto budget = static_cast<std::uint64_t>(planes * kPlaneBytes);
                PlaneWindow window(volume, kPlanes, budget, folder.path(), silent_progress());
                INFO("nz " << nz << " step " << step << " budget " << planes << " planes");
                // In memory if the planes and the rest of their last step fit.
                const std::int64_t least = std::min(nz, ceil_div(kPlanes + step - 1, step) * step);
                REQUIRE(window.on_disk() == (planes < least));
                CHECK(window.heap() <= budget);
                walk(volume, window, 0);
                for (const auto& [at, times] : volume.decoded()) {
                    if (!window.on_disk()) {
                        CHECK(times == 1);
                    }
                }
            }
        }
    }
}

TEST_CASE("skipped planes do not affect those that are needed") {
    for (const std::int64_t step : {1, 7, 16, 64}) {
        for (const std::int64_t first : {1, 2, 3}) {
            SteppedVolume volume(200, step);
            const TemporaryFolder folder;
            const std::int64_t least = ceil_div(kPlanes + step - 1, step) * step;
            PlaneWindow window(volume, kPlanes, static_cast<std::uint64_t>(least * kPlaneBytes),
                               folder.path(), silent_progress());
            REQUIRE(!window.on_disk());
            walk(volume, window, first);
            CHECK(volume.decoded().begin()->first == (32 * first - 3) / step);
        }
    }
}
